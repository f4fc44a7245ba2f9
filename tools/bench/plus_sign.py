#!/usr/bin/env python3
"""The plus-sign task over many seeds: how often it completes, how well the path is kept, how fast the loop runs.

usage: plus_sign.py [--seeds 50] [--laps 3] [--rig upm-1] [--jobs 2] [--upm target/release/upm]

Every run is the whole loop: each frame at 60/s rendered and looked at. Prints one line a seed and a summary.
"""
import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

ROOT = pathlib.Path(__file__).resolve().parents[2]


def run(upm, job, seed, out):
    command = [upm, "run", job, "--seed", str(seed), "--out", out, "--rerun", "off", "--json", "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(f"seed {seed}: exit {done.returncode}: {done.stderr}")
    return json.loads(done.stdout)


def line(seed, report):
    return (
        f"{seed:5d} {report['outcome']:10s} {report['laps']:4d} {report['plate_time_s']:9.1f} {report['pulses']:6d} "
        f"{report['cross_track_rms_mm']:9.3f} {report['cross_track_max_mm']:9.3f} {report['sensing_rms_error_mm']:9.4f} "
        f"{report['plate_time_s'] / report['wall_time_s']:7.1f}  {report['reason']}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--laps", type=int, default=3)
    parser.add_argument("--rig", default="upm-1")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--upm", default=str(ROOT / "target/release/upm"))
    args = parser.parse_args()

    job = json.loads((ROOT / "configs/plus-sign.json").read_text())
    job["task"]["laps"] = args.laps
    job["rig"] = str(ROOT / f"configs/rigs/{args.rig}.json")
    job["limits"] = {"plate_time_s": 300.0 * args.laps}
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "job.json"
        path.write_text(json.dumps(job))
        print(" seed outcome    laps plate s   pulses cross rms cross max sense rms  times  reason", flush=True)
        with ThreadPoolExecutor(args.jobs) as pool:
            runs = [pool.submit(run, args.upm, str(path), seed, folder) for seed in range(1, args.seeds + 1)]
            reports = []
            for seed, pending in enumerate(runs, 1):
                reports.append(pending.result())
                print(line(seed, reports[-1]), flush=True)

    completed = sum(report["outcome"] == "completed" for report in reports)
    cycles = sum(report["cycles"] for report in reports)
    cross = math.sqrt(sum(report["cross_track_rms_mm"] ** 2 * report["cycles"] for report in reports) / cycles)
    print(f"\ncompleted           {completed} of {len(reports)}, lost parts {sum(r['lost_parts'] for r in reports)}")
    print(f"cross-track         {cross:.3f} mm rms over all runs, worst run {max(r['cross_track_rms_mm'] for r in reports):.3f} mm rms")
    print(f"sensing error       worst run {max(r['sensing_rms_error_mm'] for r in reports):.4f} mm rms")
    speeds = sorted(r["plate_time_s"] / r["wall_time_s"] for r in reports)
    print(f"speed, {args.jobs} at once   {speeds[len(speeds) // 2]:.1f} times plate time (median), slowest {speeds[0]:.1f}")
    sys.exit(0 if completed == len(reports) else 1)


if __name__ == "__main__":
    main()
