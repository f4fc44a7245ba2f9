#!/usr/bin/env python3
"""Fast and reference vision on the same pictures in one run: times, their ratio, and how far apart the results are.

usage: locate_reference.py [--upm target/debug/upm] [--seeds 5] [--rounds 3]

Pictures: `upm-lab scene papers` (`cargo build -p upm-lab`), a white plate of 8 in with 16 pennies, 1280x1024, truth beside.
Both methods get the same file and look for pennies on a plate of 203.2 mm: `upm-lab locate --json`, with `--fast` and without.
Times are `time_us.table + time_us.parts`, from the decoded picture to corners and centres, medians over rounds in which
the methods take turns. Errors are the largest distance of a corner or centre from the truth, px.

Exit status 1 when either method misses or invents a part, or a part of the reference is farther than 0.5 px from that of the
fast one.
"""
import json
import math
import pathlib
import statistics
import sys
import tempfile

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))
from common import output_of, papers_scene, parser_of, table  # noqa: E402

NEAR_PX, AGREE_PX = 2.0, 0.5


def worst(found, wanted):
    """Largest distance of a wanted point from the nearest found one; infinite unless they pair off."""
    if len(found) != len(wanted):
        return math.inf
    farthest = max(min(math.dist(point, other) for other in found) for point in wanted)
    return farthest if farthest < NEAR_PX else math.inf


def centers(result):
    return [part["center_px"] for part in result["parts"]]


def compare(args, seed, folder):
    """A row of the table, and whether the methods find the same."""
    picture, truth = papers_scene(args.upm, seed, folder)
    lab = pathlib.Path(args.upm).with_name("upm-lab")
    methods = {"fast": ["--fast", "2"], "reference": []}
    ms, last = {name: [] for name in methods}, {}
    for _ in range(args.rounds):
        for name, extra in methods.items():
            last[name] = json.loads(output_of([lab, "locate", picture, "--json", "--kinds", "penny", *extra])[0])
            ms[name].append((last[name]["time_us"]["table"] + last[name]["time_us"]["parts"]) / 1e3)
    row, good = [seed], True
    for name, result in last.items():
        corner_px = worst(result["table"]["corners_px"], truth["table"]["corners_px"])
        part_px = worst(centers(result), [part["center_px"] for part in truth["parts"]])
        row += [f"{statistics.median(ms[name]):.2f}", f"{corner_px:.3f}", f"{part_px:.3f}"]
        good &= part_px < NEAR_PX
    apart_px = worst(centers(last["reference"]), centers(last["fast"]))
    ratio = statistics.median(ms["reference"]) / statistics.median(ms["fast"])
    return [*row, f"{apart_px:.3f}", round(ratio)], good and apart_px <= AGREE_PX


def main():
    parser = parser_of(__doc__, seeds=5, rounds=3)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = [compare(args, seed, folder) for seed in range(1, args.seeds + 1)]
    heads = [f"{name} {what}" for name in ("fast", "reference") for what in ("ms", "corner px", "part px")]
    print("\n".join(table(["seed", *heads, "apart px", "ratio"], [row for row, _ in found])))
    print(f"median ratio: {statistics.median(row[-1] for row, _ in found):.0f}")
    sys.exit(0 if all(good for _, good in found) else 1)


if __name__ == "__main__":
    main()
