#!/usr/bin/env python3
"""Loop speed of one build of upm against another, and whether both write the same journals.

usage: rival_build.py RIVAL [--rival-configs configs] [--upm target/debug/upm] [--jobs plus-sign arrange-8] [--pairs 7]

Runs each job with recording on, the two programs in turn and the first of each pair changing, and prints the ratio
of the pair's loop speeds: above 1, `--upm` is faster than RIVAL. Single times wander with the machine; quote the
median of the ratios.
"""
import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]


def run(upm, configs, job, out):
    """Plate time by wall time of one run, and its journal."""
    out.mkdir(parents=True)
    command = [upm, "run", str(configs / f"{job}.json"), "--out", str(out), "--rerun", "save", "--json", "--quiet"]
    report = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    (journal,) = out.glob("*/journal.jsonl")
    return report["plate_time_s"] / report["wall_time_s"], journal.read_bytes()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rival")
    parser.add_argument("--rival-configs", type=pathlib.Path, default=ROOT / "configs", help="where RIVAL reads fewer keys")
    parser.add_argument("--upm", default=str(ROOT / "target/debug/upm"))
    parser.add_argument("--jobs", nargs="+", default=["plus-sign", "arrange-8"])
    parser.add_argument("--pairs", type=int, default=7)
    args = parser.parse_args()

    print("job            rival: times   upm: times   upm/rival   journals")
    for job in args.jobs:
        ratios = []
        for pair in range(args.pairs):
            with tempfile.TemporaryDirectory() as folder:
                programs = {"rival": (args.rival, args.rival_configs), "upm": (args.upm, ROOT / "configs")}
                order = ["rival", "upm"] if pair % 2 == 0 else ["upm", "rival"]
                done = {name: run(*programs[name], job, pathlib.Path(folder) / name) for name in order}
            (rival, rivals_journal), (ours, our_journal) = done["rival"], done["upm"]
            ratios.append(ours / rival)
            same = "equal" if our_journal == rivals_journal else "differ"
            print(f"{job:14} {rival:12.1f} {ours:12.1f} {ratios[-1]:11.3f}   {same}", flush=True)
        print(f"{job:14} median of {args.pairs} ratios: {statistics.median(ratios):.3f}\n", flush=True)


if __name__ == "__main__":
    main()
