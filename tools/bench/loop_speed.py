#!/usr/bin/env python3
"""How fast the whole loop is against plate time, and what recording costs it.

usage: loop_speed.py [--pairs 5] [--jobs plus-sign arrange-8 arrange-16 ...] [--upm target/debug/upm]

Runs each job on one core with recording off and on in turn, prints each pair, the medians and the longest p99 of planning.
The ratio of a pair is the figure to quote; single times wander with the machine.
"""
import os
import pathlib
import statistics
import sys
import tempfile

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))
from common import ROOT, parser_of, report_of, speed_of, table  # noqa: E402


def main():
    args = parser_of(__doc__, pairs=5, jobs=["plus-sign"]).parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in args.jobs:
            job, pairs = ROOT / f"configs/{name}.json", []
            for _ in range(args.pairs):
                off, on = (report_of(args.upm, job, folder, "--rerun", rerun) for rerun in ("off", "save"))
                plan_ms = off["timing_us"]["plan"]["p99"] / 1000
                pairs.append((off["plate_time_s"], speed_of(off), speed_of(on), on["wall_time_s"] / off["wall_time_s"], plan_ms))
                rows.append((name, *pairs[-1]))
            rows.append((f"{name}, median", *map(statistics.median, zip(*pairs))))
    shown = [[name, *(f"{value:.3g}" for value in values)] for name, *values in rows]
    print("\n".join(table(("job", "plate s", "off: times", "on: times", "on/off", "plan p99 ms"), shown)))


if __name__ == "__main__":
    main()
