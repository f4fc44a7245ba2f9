#!/usr/bin/env python3
"""Dry runs against runs: the predictions of `upm check --plan` for a job, and the plate times of its runs.

usage: dry_run.py [--seeds 3] [--only NAME ...] [--planner auto|cor_sequence|synthesized_field] [--run-limit 240]
                  [--upm target/debug/upm]

Jobs are those of configs/ and two dense ones: sixteen pennies as letters, and twenty pennies on a grid of 22 mm. Each
job gets dry runs and a run with each of --seeds seeds from 1 on, on one core, one after another. --planner replaces
the planner of every job of two or more parts.

Prints a line a job: the verdicts, the median of the predicted medians, the median plate time of the runs (a run that
does not reach its goal counts as endless), their ratio, and the longest time of a check on one core. A run of more
than --run-limit s of wall time is stopped and counts as endless.

Exit status 1 when a ratio is outside 0.7 to 1.4, a check takes more than 3 s, or a verdict contradicts the runs.
"""
import argparse
import json
import math
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
LEAST, MOST, LONGEST_S = 0.7, 1.4, 3.0

LETTERS = [
    (-100, 40), (-100, 0), (-88, -38), (-62, -38), (-50, 0), (-50, 40),
    (-15, 40), (-15, 0), (-15, -40), (15, 36), (15, 2),
    (50, -40), (50, 20), (75, 0), (100, 20), (100, -40),
]  # fmt: skip
GRID = [(22.0 * (k % 5 - 2), 22.0 * (k // 5 - 1.5)) for k in range(20)]


def arranged(name, targets):
    return {
        "name": name,
        "rig": "rigs/upm-2.json",
        "parts": [{"kind": "penny", "count": len(targets)}],
        "task": {"type": "arrange", "targets_mm": [list(target) for target in targets]},
        "limits": {"plate_time_s": 600},
    }


def jobs():
    """Every job by its name, the shipped ones first."""
    shipped = [json.loads(path.read_text()) for path in sorted((ROOT / "configs").glob("*.json"))]
    dense = [arranged("letters-16", LETTERS), arranged("grid-20", GRID)]
    return {job["name"]: job for job in shipped + dense if "task" in job}


def parts(job):
    return sum(group.get("count", 1) for group in job["parts"])


def one_core():
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def timed(command, limit_s):
    """What a command prints as JSON, its exit status, and the time it took on its core, s; no JSON when it is stopped."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        done = subprocess.run(command, capture_output=True, text=True, preexec_fn=one_core, timeout=limit_s)
    except subprocess.TimeoutExpired:
        return None, None, limit_s
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(command)}: exit {done.returncode}: {done.stderr}")
    took_s = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return json.loads(done.stdout), done.returncode, took_s


def compare(upm, job, seeds, run_limit_s, folder):
    """Figures of a job over its seeds."""
    verdicts, predicted, measured, dry_run_s = [], [], [], []
    for seed in seeds:
        file = pathlib.Path(folder) / f"{job['name']}-{seed}.json"
        file.write_text(json.dumps(job | {"seed": seed}))
        rows, status, took_s = timed([upm, "check", str(file), "--plan", "--json"], 10 * LONGEST_S)
        dry_run_s.append(took_s)
        plan = rows[0]["plan"] if rows else {"verdict": "no_answer", "predicted_plate_time_s": None}
        verdicts.append((plan["verdict"], status))
        time = plan["predicted_plate_time_s"]
        predicted.append(time["median"] if time else math.inf)
        command = [upm, "run", str(file), "--out", folder, "--rerun", "off", "--json"]
        report, _, _ = timed(command, run_limit_s)
        is_done = report is not None and report["outcome"] == "completed"
        measured.append(report["plate_time_s"] if is_done else math.inf)
    return verdicts, statistics.median(predicted), statistics.median(measured), max(dry_run_s), measured


def faults(verdicts, predicted_s, measured_s, dry_run_s, measured):
    """What of a job's figures misses a bar."""
    if dry_run_s > LONGEST_S:
        yield f"took {dry_run_s:.1f} s"
    if math.isfinite(predicted_s) and math.isfinite(measured_s):
        if not LEAST <= predicted_s / measured_s <= MOST:
            yield f"ratio {predicted_s / measured_s:.2f}"
    elif math.isfinite(predicted_s) != math.isfinite(measured_s):
        yield "prediction and runs do not agree"
    for (verdict, status), time_s in zip(verdicts, measured):
        if status == 1 and math.isfinite(time_s):
            yield f"exit 1, {verdict}, of a job that gets done"


def shown(time_s):
    return f"{time_s:9.1f}" if math.isfinite(time_s) else f"{'not done':>9}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    every = jobs()
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", nargs="+", choices=every, default=list(every), metavar="NAME")
    parser.add_argument("--planner", choices=["auto", "cor_sequence", "synthesized_field"])
    parser.add_argument("--run-limit", type=float, default=240.0, help="most wall time of a run, s")
    parser.add_argument("--upm", default=str(ROOT / "target/debug/upm"))
    args = parser.parse_args()
    missed = []
    print("job              predicted  measured  ratio  dry run s  verdicts, faults")
    with tempfile.TemporaryDirectory() as folder:
        for name in args.only:
            job = every[name] | {"rig": str(ROOT / "configs" / every[name]["rig"])}
            if args.planner and parts(job) > 1:
                job["planner"] = args.planner
            figures = compare(args.upm, job, range(1, args.seeds + 1), args.run_limit, folder)
            verdicts, predicted_s, measured_s, dry_run_s, _ = figures
            found = list(faults(*figures))
            missed += [f"{name}: {fault}" for fault in found]
            ratio = predicted_s / measured_s if math.isfinite(predicted_s) and math.isfinite(measured_s) else math.nan
            words = ", ".join(sorted({verdict for verdict, _ in verdicts}) + [f"MISSED: {fault}" for fault in found])
            times = f"{shown(predicted_s)} {shown(measured_s)} {ratio:6.2f} {dry_run_s:10.2f}"
            print(f"{name:16} {times}  {words}", flush=True)
    for miss in missed:
        print(f"missed: {miss}", file=sys.stderr)
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
