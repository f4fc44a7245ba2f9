#!/usr/bin/env python3
"""How fast the whole loop is against plate time, and what recording costs it.

usage: loop_speed.py [--pairs 5] [--rig upm-1] [--upm target/debug/upm]

Runs the plus-sign job with recording off and on in turn, prints each pair and the medians. The ratio of a pair is the
figure to quote; single times wander with the machine. Also prints the size of one lap's recording.
"""
import json
import pathlib
import statistics
import sys
import tempfile

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))
from common import ROOT, config, parser_of, report_of, speed_of, table  # noqa: E402


def main():
    args = parser_of(__doc__, pairs=5, rig="upm-1").parse_args()
    job = config("plus-sign") | {"rig": str(ROOT / f"configs/rigs/{args.rig}.json")}
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "job.json"
        path.write_text(json.dumps(job))
        for _ in range(args.pairs):
            off, on = (report_of(args.upm, path, folder, "--rerun", rerun) for rerun in ("off", "save"))
            rows.append((off["plate_time_s"], speed_of(off), speed_of(on), on["wall_time_s"] / off["wall_time_s"]))
        megabytes = max(file.stat().st_size for file in pathlib.Path(folder).glob("*/run.rrd")) / 1e6

    shown = [[f"{value:.3g}" for value in row] for row in rows]
    print("\n".join(table(("plate s", "off: times", "on: times", "on/off"), shown)))
    _, off, on, cost = (statistics.median(column) for column in zip(*rows))
    print(f"\nloop, recording off {off:.1f} times plate time (median)")
    print(f"loop, recording on  {on:.1f} times plate time (median)")
    print(f"recording costs     {100 * (cost - 1):.1f} % (median of pairs)")
    print(f"recording           {megabytes:.1f} MB for one lap")


if __name__ == "__main__":
    main()
