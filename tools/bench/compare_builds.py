#!/usr/bin/env python3
"""Compares builds of upm on the arrange jobs of many_coins.py: plate time, touches and planning time over the same seeds.

usage: compare_builds.py --build NAME=PATH [--build NAME=PATH ...] [--only arrange-8 arrange-16 arrange-24]
                         [--seeds 20] [--first-seed 1] [--spread 0.1]

Every run is the whole loop on upm-2 without recording, one at a time on one core. The builds take turns within a seed, so a
busy machine slows all of them alike. Runs are deterministic: only the planning times differ from one campaign to the next.
Prints one line a run and a Markdown table. A run that is not completed counts as endless in the median.
"""
import argparse
import statistics
import tempfile

from many_coins import JOBS, Bench, completed, line, median_s, over, p99, shown, values


def build(text):
    name, _, path = text.partition("=")
    if not path:
        raise argparse.ArgumentTypeError(f"expected NAME=PATH, found {text!r}")
    return name, path


def row(job, name, reports):
    cycles = [ms for report in reports for ms in report.get("plan_ms", [])]
    worst_s = over(max, values(completed(reports), "plate_time_s"))
    cells = [
        job,
        name,
        f"{len(completed(reports))} of {len(reports)}",
        shown(median_s(reports), 2, 0),
        shown(over(statistics.mean, values(completed(reports), "plate_time_s")), 2, 0),
        shown(worst_s, 1, 0),
        sum(values(reports, "pulses")),
        sum(values(reports, "collisions")),
        sum(values(reports, "lost_parts")),
        shown(over(statistics.median, cycles), 2, 0),
        shown(over(p99, cycles), 2, 0),
        shown(over(max, cycles), 1, 0),
    ]
    return f"| {' | '.join(map(str, cells))} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=build, action="append", required=True, metavar="NAME=PATH")
    parser.add_argument("--only", nargs="+", choices=JOBS, default=["arrange-8", "arrange-16", "arrange-24"], metavar="JOB")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--spread", type=float, default=0.1, help="relative standard deviation of friction from part to part")
    args = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for job in args.only:
            reports = {name: [] for name, _ in args.build}
            for seed in range(args.first_seed, args.first_seed + args.seeds):
                for name, path in args.build:
                    report = Bench(path, folder, args.spread).run(job, "synthesized_field", seed, one_core=True)
                    reports[name].append(report)
                    print(f"{name:10} {line(job, seed, report)}", flush=True)
            rows += [row(job, name, found) for name, found in reports.items()]
    columns = "job | build | done | median s | mean s | worst s | pulses | touches | lost | plan p50 ms | p99 ms | longest ms"
    print(f"\n| {columns} |\n|{'---|' * len(columns.split('|'))}")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
