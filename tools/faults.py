#!/usr/bin/env python3
"""The judge of runs with faults: what they claim against what truly happened.

usage: faults.py judge     [--bars] [RUN_FOLDER ...]
       faults.py evidence  CAMPAIGN_FOLDER
       faults.py mutants   --guards a,b,c [--runs 1000]
       faults.py schedules [--jobs-per 3] [--seeds 2] [--planner moving_field] [--only WORD ...]
       faults.py daemon    [--jobs-per 3] [--seeds 1] [--only WORD ...] [--no-estops]
       faults.py selftest
options of all that run: [--upm target/debug/upm] [--jobs CORES]

judge      the oracle (tools/faults/oracle.py), by the rules O1 to O10, over run folders. Without any it answers for
           `upm campaign`: the faulty campaign is
               upm campaign configs/campaigns/faulty.json --judge 'python3 tools/faults.py judge' --keep failures
           With --bars a fault that is noticed too late is a violation, too.
evidence   how near the healthy runs of a campaign came to the findings that rest on chance: the figures of the limits.
mutants    counts the runs of the faulty campaign until one breaks a rule with one guard off (a build with the feature
           `mutants`), not with all on.
schedules  the 55 schedules with a name, against the bars by which their faults have to be noticed.
daemon     the same schedules as jobs of one daemon, each with a job queued behind it: a plate pauses with cause and remedy
           exactly where a person has to look (O7), the next job completes after `resume` (O9), each run ends as it does
           alone (O10). Emergency stops in the middle of runs with faults.
selftest   the oracle over folders and answers made by hand.

Exit status 1 when a rule is broken, a bar is missed or a mutant goes on uncaught.
"""
import argparse
import os
import pathlib
import shutil
import sys
import unittest

from common import ROOT, output_of, table
from faults import daemon_tier, judge, schedules
from faults.runs import Runner

BATCH = 100


def run_schedules(args):
    return schedules.run_all(args.upm, judging(args.upm), args.jobs_per, args.seeds, args.jobs, args.only, args.planner)


def run_daemon(args):
    return daemon_tier.run_all(Runner(args.upm), args.jobs_per, args.seeds, args.jobs, args.only, not args.no_estops)


def run_judge(args):
    runner, good = Runner(args.upm), True
    if not args.folders:
        judge.answer(runner, args.bars)
    for folder in args.folders:
        found = judge.of_folder(runner, pathlib.Path(folder), wants_bars=args.bars)
        good &= not found
        print(f"{folder}: {len(found)} violations", *(f"\n  {violation}" for violation in found))
    return good


def run_evidence(args):
    judge.print_tails(args.folder)
    return True


def judging(upm):
    """The command that judges runs, bars included."""
    return f"{sys.executable} {ROOT / 'tools/faults.py'} judge --bars --upm {upm}"


def faulty_runs(upm, out, runs, *options):
    """Makes runs of the faulty campaign, judged; the lines of those that break a rule."""
    file = ROOT / "configs/campaigns/faulty.json"
    output_of([upm, "campaign", file, "--out", out, "--runs", runs, "--judge", judging(upm), "--quiet", *options], (0, 1))
    return [line for line in judge.lines_of(out) if line.get("violations")]


def run_mutants(args):
    rows, folder = [], ROOT / "target/mutants"
    for guard in args.guards.split(","):
        caught = None
        for first in range(1, args.runs + 1, BATCH):
            runs = f"{first}..{min(first + BATCH - 1, args.runs)}"
            for line in faulty_runs(args.upm, folder / guard, runs, "--without-guard", guard):
                sound = faulty_runs(args.upm, folder / "sound", line["run"])
                known = {rule(said) for other in sound if other["run"] == line["run"] for said in other["violations"]}
                caught = caught or next(((line["run"], said) for said in line["violations"] if rule(said) not in known), None)
            if caught:
                break
        shutil.rmtree(folder / guard, ignore_errors=True)
        rows.append([guard, *(caught or (f"not in {args.runs}", "-"))])
        print("  ".join(map(str, rows[-1])), flush=True)
    print("\n".join(table(["guard", "runs until caught", "by"], rows)))
    return all(isinstance(row[1], int) for row in rows)


def rule(violation):
    return violation.split(":")[0]


def run_selftest(_):
    from faults import selftest, selftest_daemon

    tests = map(unittest.defaultTestLoader.loadTestsFromModule, (selftest, selftest_daemon))
    return unittest.TextTestRunner().run(unittest.TestSuite(tests)).wasSuccessful()


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    running = argparse.ArgumentParser(add_help=False)
    running.add_argument("--upm", default=str(ROOT / "target/debug/upm"))
    running.add_argument("--jobs", type=int, default=os.cpu_count(), help="runs at once")

    def add(name, does, *parents):
        command = commands.add_parser(name, parents=parents)
        command.set_defaults(does=does)
        return command

    command = add("judge", run_judge, running)
    command.add_argument("folders", nargs="*", metavar="RUN_FOLDER")
    command.add_argument("--bars", action="store_true", help="faults noticed too late are violations, too")
    add("evidence", run_evidence).add_argument("folder", metavar="CAMPAIGN_FOLDER")
    command = add("mutants", run_mutants, running)
    command.add_argument("--guards", required=True, help="names, with commas between")
    command.add_argument("--runs", type=int, default=1000)
    named = argparse.ArgumentParser(add_help=False)
    named.add_argument("--jobs-per", type=int, default=3, choices=range(1, len(schedules.JOBS) + 1))
    named.add_argument("--only", nargs="+", metavar="WORD", help="schedules with one of these in their names")
    command = add("schedules", run_schedules, running, named)
    command.add_argument("--seeds", type=int, default=2)
    command.add_argument("--planner", default="synthesized_field", help="of the jobs on upm-2, the endless ones aside")
    command = add("daemon", run_daemon, running, named)
    command.add_argument("--seeds", type=int, default=1)
    command.add_argument("--no-estops", action="store_true", help="no emergency stops")
    add("selftest", run_selftest)
    return parser.parse_args()


if __name__ == "__main__":
    args = arguments()
    sys.exit(0 if args.does(args) else 1)
