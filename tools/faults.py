#!/usr/bin/env python3
"""The fault campaign: runs with faults that begin inside them, judged by what truly happened.

usage: faults.py campaign  [--seeds 200] [--first 0] [--half safety|liveness|both] [--keep DIR] [--no-shrink]
       faults.py healthy   [--seeds 200] [--first 0] [--keep DIR]
       faults.py schedules [--jobs-per 3] [--seeds 2] [--planner moving_field] [--only WORD ...]
       faults.py daemon    [--jobs-per 3] [--seeds 1] [--only WORD ...] [--no-estops]
       faults.py judge RUN_FOLDER ...
       faults.py mutants --guards a,b,c [--seeds 1000]
       faults.py selftest
options of all that run: [--upm target/debug/upm] [--jobs CORES]

campaign   draws job and schedule by seed, runs each in a process of its own on all cores and judges it by the rules
           O1 to O10 (tools/faults/oracle.py). Prints violations with the smallest command that still fails, outcomes and
           guards by kind, needless stops and the rate of violations with its 95 % bound.
healthy    drawn jobs without faults (any task, 2 to 30 parts, every tenth the letters): no finding may end or slow one.
schedules  the 55 schedules with a name, against the bars by which their faults have to be noticed.
daemon     the same schedules as jobs of one daemon, each with a job queued behind it: a plate pauses with cause and remedy
           exactly where a person has to look (O7), the next job completes after `resume` (O9), each run ends as it does
           alone (O10). Emergency stops in the middle of runs with faults.
mutants    counts the seeds until a rule is broken with one guard off (a build with the feature `mutants`), not with all on.
judge      the oracle alone, over run folders. selftest: over folders and answers made by hand.

Exit status 1 when a rule is broken, a bar is missed, a drawn run is refused or a mutant goes on uncaught.
"""
import argparse
import os
import pathlib
import sys
import unittest

from common import ROOT, table
from faults import campaign, daemon_tier, oracle, schedules
from faults.runs import Runner


def run_campaign(args):
    found = campaign.Campaign(Runner(args.upm), args)
    wall_s = found.run()
    return campaign.report(found.verdicts, wall_s, found.runner, args)


def run_healthy(args):
    healthy = campaign.Campaign(Runner(args.upm), args, campaign.healthy_case)
    wall_s = healthy.run()
    return campaign.report_healthy(healthy.verdicts, wall_s)


def run_schedules(args):
    return schedules.run_all(Runner(args.upm), args.jobs_per, args.seeds, args.jobs, args.only, args.planner)


def run_daemon(args):
    return daemon_tier.run_all(Runner(args.upm), args.jobs_per, args.seeds, args.jobs, args.only, not args.no_estops)


def run_judge(args):
    good = True
    for folder in args.folders:
        run, found = oracle.judge_folder(folder)
        good &= not found
        print(f"{folder}: {run.outcome if run else 'unreadable'}, {len(found)} violations")
        for violation in found:
            print(f"  {violation}{' (no picture shows it)' if violation.is_unobservable else ''}")
    return good


def run_mutants(args):
    rows, args.sound = [], Runner(args.upm)
    for guard in args.guards.split(","):
        found = campaign.Campaign(Runner(args.upm, without_guard=guard), args)
        found.run()
        refused = {verdict.told for verdict in found.verdicts if verdict.outcome == "refused"}
        if refused:
            sys.exit(f"{guard}: runs are refused: {refused.pop()}")
        caught = next((verdict for verdict in found.verdicts if campaign.seen(verdict)), None)
        seeds = caught.case.seed - args.first + 1 if caught else None
        rows.append([guard, seeds or f"not in {args.seeds}", campaign.seen(caught)[0] if caught else "-"])
        print("  ".join(map(str, rows[-1])), flush=True)
    print("\n".join(table(["guard", "seeds until caught", "by"], rows)))
    return all(isinstance(row[1], int) for row in rows)


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
    drawing = argparse.ArgumentParser(add_help=False)
    drawing.set_defaults(no_shrink=False, sound=None, half="both")
    drawing.add_argument("--first", type=int, default=0, help="the first seed")
    drawing.add_argument("--keep", type=pathlib.Path, help="where folders of failing runs and shrunk jobs are kept")

    def add(name, does, *parents):
        command = commands.add_parser(name, parents=parents)
        command.set_defaults(does=does)
        return command

    halves = argparse.ArgumentParser(add_help=False)
    halves.add_argument("--half", choices=("safety", "liveness", "both"), help="faults that stay, that end, either")
    many = argparse.ArgumentParser(add_help=False)
    many.add_argument("--seeds", type=int, default=200)
    add("campaign", run_campaign, running, drawing, many, halves).add_argument("--no-shrink", action="store_true")
    add("healthy", run_healthy, running, drawing, many)
    named = argparse.ArgumentParser(add_help=False)
    named.add_argument("--jobs-per", type=int, default=3, choices=range(1, len(schedules.JOBS) + 1))
    named.add_argument("--only", nargs="+", metavar="WORD", help="schedules with one of these in their names")
    command = add("schedules", run_schedules, running, named)
    command.add_argument("--seeds", type=int, default=2)
    command.add_argument("--planner", default="synthesized_field", help="of the jobs on upm-2, the endless ones aside")
    command = add("daemon", run_daemon, running, named)
    command.add_argument("--seeds", type=int, default=1)
    command.add_argument("--no-estops", action="store_true", help="no emergency stops")
    add("judge", run_judge).add_argument("folders", nargs="+", metavar="RUN_FOLDER")
    command = add("mutants", run_mutants, running, drawing, halves)
    command.add_argument("--guards", required=True, help="names, with commas between")
    command.add_argument("--seeds", type=int, default=1000)
    add("selftest", run_selftest)
    return parser.parse_args()


if __name__ == "__main__":
    args = arguments()
    sys.exit(0 if args.does(args) else 1)
