#!/usr/bin/env python3
"""Runs without pixels against runs with them: success, plate time and speed.

usage: without_pixels.py [--seeds 200] [--jobs sort-8 arrange-8 ...] [--upm target/debug/upm]

Runs each job of configs/ with the seeds 1 to --seeds, once with `--camera positions` and once with `--camera pixels`.
Prints a line a job and camera: runs that completed, median plate time, and plate time over wall time of one run on its
core (median); then how much longer a run without pixels takes than the run with pixels of the same seed: mean of the
logarithms of the ratio with its standard error.

Exit status 1 when that mean is beyond 5 % by more than twice its error, or when more than 2.5 % of the runs lie between
the successes.
"""
import argparse
import json
import math
import pathlib
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
MOST_TIME, MOST_SUCCESS = 0.05, 0.025


def batch(upm, job, seeds, camera, folder):
    """Plate time of each completed run by its seed, s, and median speed of these runs."""
    out = pathlib.Path(folder) / f"{job}-{camera}"
    command = [upm, "run", str(ROOT / "configs" / f"{job}.json"), "--seeds", f"1..{seeds}", "--camera", camera]
    done = subprocess.run([*command, "--out", str(out), "--quiet"], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(command)}: exit {done.returncode}: {done.stderr}")
    summary = json.loads((out / "summary.json").read_text())
    runs = [run for run in summary["runs"] if run["status"] == 0]
    speeds = [run["plate_time_s"] / run["wall_time_s"] for run in runs]
    return {run["seed"]: run["plate_time_s"] for run in runs}, statistics.median(speeds or [0.0])


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
            times = {}
            for camera in ["positions", "pixels"]:
                times[camera], speed = batch(args.upm, job, args.seeds, camera, folder)
                done, time_s = len(times[camera]), statistics.median(times[camera].values() or [float("nan")])
                print(f"{job:16} {camera:10} {done:4} of {args.seeds:3} {time_s:10.2f} s {speed:12.0f}", flush=True)
            made, seen = times["positions"], times["pixels"]
            longer = [math.log(made[seed] / seen[seed]) for seed in made if seed in seen]
            mean, error = statistics.mean(longer), statistics.stdev(longer) / math.sqrt(len(longer))
            print(f"{job:16} longer without pixels by {100.0 * mean:.1f} % ± {100.0 * error:.1f} %", flush=True)
            if abs(mean) > MOST_TIME + 2.0 * error:
                missed.append(f"{job}: plate times differ by {100.0 * mean:.1f} %")
            if abs(len(made) - len(seen)) > MOST_SUCCESS * args.seeds:
                missed.append(f"{job}: {len(made)} and {len(seen)} runs completed")
    for miss in missed:
        print(f"missed: {miss}", file=sys.stderr)
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
