#!/usr/bin/env python3
"""Fast and reference vision on the same pictures in one run: times, their ratio, and how far apart the results are.

usage: locate_reference.py [--upm target/debug/upm] [--seeds 5] [--rounds 3] [--json]

Pictures: `upm-lab scene papers` (`cargo build -p upm-lab`), a white plate of 8 in with 16 pennies, 1280x1024, truth beside. Both methods get the
same file and looks for pennies on a plate of 203.2 mm: `upm locate --json` and `upm-lab locate --json`. Times are `time_us.table + time_us.parts`, from the
decoded picture to corners and centres, medians over rounds in which the methods take turns; the survey of other discs
and of outlines, which the reference method does not do, is the column beside. Errors are the largest distance
of a corner or centre from the truth, px.

Exit status 1 when either method misses or invents a part, or a part of the reference is farther than 0.5 px from that of the
fast one.
"""
import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
NEAR_PX, AGREE_PX = 2.0, 0.5
SIDE = ["--plate-side-mm", "203.2"]


def upm_json(command):
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def distance(a, b):
    return ((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) ** 0.5


def worst(found, wanted):
    """Largest distance of a wanted point from the nearest found one; infinite unless they pair off."""
    if len(found) != len(wanted):
        return float("inf")
    nearest = [min(distance(point, other) for other in found) for point in wanted]
    return max(nearest) if max(nearest) < NEAR_PX else float("inf")


def centers(result):
    return [part["center_px"] for part in result["parts"]]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--upm", default=str(ROOT / "target/debug/upm"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    lab = pathlib.Path(args.upm).with_name("upm-lab")

    rows, good = [], True
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(1, args.seeds + 1):
            picture, truth = pathlib.Path(folder) / f"{seed}.pgm", pathlib.Path(folder) / f"{seed}.json"
            render = [lab, "scene", "papers", "--seed", str(seed), "--out", picture, "--truth", truth]
            subprocess.run(render, capture_output=True, check=True)
            truth = json.loads(truth.read_text())
            programs = {"fast": [args.upm, *SIDE], "reference": [lab]}
            times, last, survey_ms = {name: [] for name in programs}, {}, []
            for _ in range(args.rounds):
                for name, (program, *extra) in programs.items():
                    last[name] = upm_json([program, "locate", picture, "--json", "--kinds", "penny", *extra])
                    time_us = last[name]["time_us"]
                    times[name].append((time_us["table"] + time_us["parts"]) / 1e3)
                    survey_ms += [time_us["survey"] / 1e3] if name == "fast" else []
            ms = {name: statistics.median(values) for name, values in times.items()}
            row = {"seed": seed, "ratio": ms["reference"] / ms["fast"]}
            for name, result in last.items():
                row[name] = {
                    "ms": ms[name],
                    "corner_px": worst(result["table"]["corners_px"], truth["table"]["corners_px"]),
                    "part_px": worst(centers(result), [part["center_px"] for part in truth["parts"]]),
                }
            row["survey_ms"] = statistics.median(survey_ms)
            row["apart_px"] = worst(centers(last["reference"]), centers(last["fast"]))
            good = good and row["apart_px"] <= AGREE_PX
            good = good and all(row[name]["part_px"] < NEAR_PX for name in programs)
            rows.append(row)
    if args.json:
        print(json.dumps(rows))
        return 0 if good else 1
    print("seed   fast: ms  survey ms  corner px  part px   reference: ms  corner px  part px   apart px   ratio")
    for row in rows:
        fast, reference = row["fast"], row["reference"]
        print(
            f"{row['seed']:4}  {fast['ms']:10.2f} {row['survey_ms']:10.2f} {fast['corner_px']:10.3f} {fast['part_px']:8.3f}"
            f" {reference['ms']:15.0f} {reference['corner_px']:10.3f} {reference['part_px']:8.3f}"
            f" {row['apart_px']:10.3f} {row['ratio']:7.0f}"
        )
    print(f"median ratio: {statistics.median(row['ratio'] for row in rows):.0f}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
