#!/usr/bin/env python3
"""Holds the summary of a campaign against its bars.

usage: bars.py CAMPAIGN_FOLDER [BARS]

BARS names a set of tools/bench/bars.json, else it is the campaign's name. A bar is for a cell, or `*` for each: the least
share of successes (`success`, 1 where none is given), the most that the median of a figure may be (`median`), and any run's
(`most`). Prints a row a bar; exit status 1 when one is missed.
"""
import json
import pathlib
import sys

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))
from common import Bars  # noqa: E402


def hold(bars, cell, wanted):
    name = cell["cell"] or "runs"
    share = cell["success"]["value"] if cell["success"] else 0.0
    least = wanted.get("success", 1.0)
    bars.hold(f"{name}: success", f"{100 * least:g} %", f"{100 * share:.1f} % of {cell['runs']}", share >= least)
    for kind in ("median", "most"):
        for figure, most in wanted.get(kind, {}).items():
            found = cell["figures"].get(figure)
            value = found and (found["median"]["value"] if kind == "median" else found["most"])
            bars.hold(f"{name}: {kind} {figure}", f"{most:g}", "-" if value is None else f"{value:.4g}", value is not None and value <= most)


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    summary = json.loads((pathlib.Path(sys.argv[1]) / "summary.json").read_text())
    known = json.loads(pathlib.Path(__file__).with_name("bars.json").read_text())
    wanted = known.get(sys.argv[-1] if len(sys.argv) == 3 else summary["name"])
    if wanted is None:
        sys.exit(f"bars.py: expected one of {', '.join(known)}, found {sys.argv[-1]}")
    bars = Bars()
    for cell in filter(lambda cell: cell["runs"], summary["of_cells"]):
        of = wanted.get(cell["cell"], wanted.get("*"))
        if of is not None:
            hold(bars, cell, of)
    bars.close()


if __name__ == "__main__":
    main()
