#!/usr/bin/env python3
"""Runs without pixels against runs with them: success, plate time and speed.

usage: without_pixels.py [--seeds 200] [--jobs sort-8 arrange-8 ...] [--upm target/debug/upm]

Runs each job of configs/ with the seeds 1 to --seeds, with `--camera positions` and with `--camera pixels`. Prints runs that
completed, median plate time and speed of each; then how much longer a run without pixels takes than that with pixels of the
same seed: mean of the logarithms of the ratio with its standard error.

Exit status 1 when that mean is beyond 5 % by more than twice its error, or when more than 2.5 % of the runs lie between
the successes.
"""
import json
import math
import pathlib
import statistics
import sys
import tempfile

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))
from common import ROOT, Bars, output_of, parser_of, speed_of  # noqa: E402

MOST_TIME, MOST_SUCCESS = 0.05, 0.025


def batch(upm, job, seeds, camera, folder):
    """Plate time of each completed run by its seed, s, and median speed of these runs."""
    out = pathlib.Path(folder) / f"{job}-{camera}"
    wanted = [ROOT / f"configs/{job}.json", "--seeds", f"1..{seeds}", "--camera", camera]
    output_of([upm, "run", *wanted, "--out", out, "--quiet"], (0, 1))
    runs = [run for run in json.loads((out / "summary.json").read_text())["runs"] if run["status"] == 0]
    return {run["seed"]: run["plate_time_s"] for run in runs}, statistics.median(list(map(speed_of, runs)) or [0.0])


def main():
    args = parser_of(__doc__, seeds=200, jobs=["sort-8", "arrange-8"]).parse_args()
    bars = Bars()
    with tempfile.TemporaryDirectory() as folder:
        for job in args.jobs:
            times = {}
            for camera in ["positions", "pixels"]:
                times[camera], speed = batch(args.upm, job, args.seeds, camera, folder)
                time_s = statistics.median(times[camera].values() or [math.nan])
                told = f"{len(times[camera])} of {args.seeds} in {time_s:.2f} s, {speed:.0f} times plate time"
                bars.tell(f"{job}, {camera}", told)
            made, seen = times["positions"], times["pixels"]
            longer = [math.log(made[seed] / seen[seed]) for seed in made if seed in seen]
            mean, error = statistics.mean(longer), statistics.stdev(longer) / math.sqrt(len(longer))
            told = f"{100 * mean:.1f} % ± {100 * error:.1f} %"
            bars.hold(f"{job}, longer without pixels", f"{MOST_TIME:.0%}", told, abs(mean) <= MOST_TIME + 2 * error)
            apart = abs(len(made) - len(seen))
            bars.hold(f"{job}, successes apart", f"{MOST_SUCCESS:.1%}", apart, apart <= MOST_SUCCESS * args.seeds)
    bars.close()


if __name__ == "__main__":
    main()
