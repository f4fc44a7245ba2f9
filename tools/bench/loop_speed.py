#!/usr/bin/env python3
"""How fast the whole loop is against plate time, and what recording costs it.

usage: loop_speed.py [--pairs 5] [--rig upm-1] [--upm target/debug/upm]

Runs the plus-sign job with recording off and on in turn, prints each pair and the medians. The ratio of a pair is the
figure to quote; single times wander with the machine. Also prints the size of one lap's recording and how long
`upm --version` takes as a whole process.
"""
import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]


def run(upm, job, out, rerun):
    command = [upm, "run", str(job), "--out", out, "--rerun", rerun, "--json", "--quiet"]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--rig", default="upm-1")
    parser.add_argument("--upm", default=str(ROOT / "target/debug/upm"))
    args = parser.parse_args()

    job = json.loads((ROOT / "configs/plus-sign.json").read_text())
    job["rig"] = str(ROOT / f"configs/rigs/{args.rig}.json")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "job.json"
        path.write_text(json.dumps(job))
        print("plate s   off: wall s  times   on: wall s  times   on/off")
        for _ in range(args.pairs):
            off = run(args.upm, path, folder, "off")
            on = run(args.upm, path, folder, "save")
            speed = [r["plate_time_s"] / r["wall_time_s"] for r in (off, on)]
            rows.append((speed[0], speed[1], on["wall_time_s"] / off["wall_time_s"]))
            print(
                f"{off['plate_time_s']:7.1f} {off['wall_time_s']:12.2f} {speed[0]:6.1f} {on['wall_time_s']:12.2f} "
                f"{speed[1]:6.1f} {rows[-1][2]:8.3f}",
                flush=True,
            )
        megabytes = max(file.stat().st_size for file in pathlib.Path(folder).glob("*/run.rrd")) / 1e6

    starts = []
    for _ in range(20):
        begin = time.perf_counter()
        subprocess.run([args.upm, "--version"], capture_output=True, check=True)
        starts.append(1e3 * (time.perf_counter() - begin))
    print(f"\nloop, recording off {statistics.median(r[0] for r in rows):.1f} times plate time (median)")
    print(f"loop, recording on  {statistics.median(r[1] for r in rows):.1f} times plate time (median)")
    print(f"recording costs     {100 * (statistics.median(r[2] for r in rows) - 1):.1f} % (median of pairs)")
    print(f"recording           {megabytes:.1f} MB for one lap")
    print(f"upm --version       {statistics.median(starts):.1f} ms median, {max(starts):.1f} ms worst of 20")


if __name__ == "__main__":
    main()
