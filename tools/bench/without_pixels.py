#!/usr/bin/env python3
"""Runs without pixels against runs with them: success, plate time and speed.

usage: without_pixels.py [--seeds 200] [--jobs sort-8 arrange-8 ...] [--upm target/debug/upm]

Runs each job of configs/ with the seeds 1 to --seeds, once with `--camera positions` and once with `--camera pixels`.
Prints a line a job and camera: runs that completed, median plate time, and plate time over wall time of one run on its
core (median).

Exit status 1 when more than 5 % lie between the two median times, or more than 2.5 % of the runs between the successes.
"""
import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
MOST_TIME, MOST_SUCCESS = 0.05, 0.025


def batch(upm, job, seeds, camera, folder):
    """Completed runs, median plate time, s, and median speed of the runs of a batch."""
    out = pathlib.Path(folder) / f"{job}-{camera}"
    command = [upm, "run", str(ROOT / "configs" / f"{job}.json"), "--seeds", f"1..{seeds}", "--camera", camera]
    done = subprocess.run([*command, "--out", str(out), "--quiet"], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(command)}: exit {done.returncode}: {done.stderr}")
    summary = json.loads((out / "summary.json").read_text())
    runs = [run for run in summary["runs"] if run["status"] == 0]
    speeds = [run["plate_time_s"] / run["wall_time_s"] for run in runs]
    time_s = summary["figures"]["plate_time_s"]["median"] if runs else float("inf")
    return summary["completed"], time_s, statistics.median(speeds or [0.0])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--jobs", nargs="+", default=["sort-8", "arrange-8"], metavar="JOB")
    parser.add_argument("--upm", default=str(ROOT / "target/debug/upm"))
    args = parser.parse_args()
    missed = []
    print("job              camera     completed   plate time  times plate time")
    with tempfile.TemporaryDirectory() as folder:
        for job in args.jobs:
            figures = {}
            for camera in ["positions", "pixels"]:
                figures[camera] = batch(args.upm, job, args.seeds, camera, folder)
                completed, time_s, speed = figures[camera]
                print(f"{job:16} {camera:10} {completed:4} of {args.seeds:3} {time_s:10.2f} s {speed:12.0f}", flush=True)
            (completed, time_s, _), (seen, seen_s, _) = figures["positions"], figures["pixels"]
            if not abs(time_s / seen_s - 1.0) <= MOST_TIME:
                missed.append(f"{job}: plate times differ by {100.0 * (time_s / seen_s - 1.0):.1f} %")
            if abs(completed - seen) > MOST_SUCCESS * args.seeds:
                missed.append(f"{job}: {completed} and {seen} runs completed")
    for miss in missed:
        print(f"missed: {miss}", file=sys.stderr)
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
