"""Shared by the tools: options, the venv of a tool that needs packages, runs of `upm`, figures and tables."""
import argparse
import json
import math
import os
import pathlib
import re
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field

ROOT = pathlib.Path(__file__).resolve().parents[1]


def parser_of(doc, **options):
    """A parser with `--upm` and an option for each default in `options`, of the default's type; a list takes several."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--upm", default=str(ROOT / "target/debug/upm"))
    for name, default in options.items():
        several = isinstance(default, list)
        kind = type(default[0] if several else default)
        parser.add_argument(f"--{name.replace('_', '-')}", type=kind, nargs="+" if several else None, default=default)
    return parser


def enter_venv(folder, packages, modules=None):
    """Starts the running script again in the venv `folder`, made and filled with `packages` where they are missing.

    `modules` are the names they are imported by, where those are not the packages' own.
    """
    folder = pathlib.Path(folder)
    python = folder / "bin/python"
    if pathlib.Path(sys.prefix).resolve() == folder.resolve():
        return
    modules = modules or [re.split("[<>=]", package)[0] for package in packages]
    present = [python, "-c", f"import {', '.join(modules)}"]
    if not python.exists() or subprocess.run(present, capture_output=True).returncode:
        print(f"installing {', '.join(packages)} into {folder}", file=sys.stderr, flush=True)
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *packages], check=True)
    os.execv(python, [python, *sys.argv])


def config(name):
    """A file below configs/, read."""
    return json.loads((ROOT / f"configs/{name}.json").read_text())


def output_of(command, good=(0,), **options):
    """Standard output and error of a command; the tool ends where its status is not one of `good`."""
    command = list(map(str, command))
    done = subprocess.run(command, capture_output=True, text=True, **options)
    if done.returncode not in good:
        sys.exit(f"{' '.join(command)}: exit {done.returncode}: {done.stderr.strip()}")
    return done.stdout, done.stderr


def report_of(upm, job, out, *options):
    """The report of `upm run`, whether or not it was completed."""
    command = [upm, "run", job, "--out", out, "--json", "--quiet", *options]
    return json.loads(output_of(command, (0, 1))[0])


def simulate(upm, experiment):
    """The output of `upm simulate`, and the CPU time of the process, s."""
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump(experiment, file)
        file.flush()
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        told, _ = output_of([upm, "simulate", file.name, "--json"])
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return json.loads(told), after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def papers_scene(upm, seed, folder):
    """A rendered picture of the papers' plate with 16 pennies, and its truth; needs `cargo build -p upm-lab`."""
    picture, truth = (pathlib.Path(folder) / f"papers-{seed}.{suffix}" for suffix in ("pgm", "json"))
    lab = pathlib.Path(upm).with_name("upm-lab")
    output_of([lab, "scene", "papers", "--seed", seed, "--out", picture, "--truth", truth])
    return picture, json.loads(truth.read_text())


def speed_of(report):
    """How many times faster than plate time a run was; None where it has no times."""
    plate_s, wall_s = report.get("plate_time_s"), report.get("wall_time_s")
    return plate_s / wall_s if plate_s and wall_s else None


def percentile(found, share):
    """By nearest rank; NaN of nothing."""
    return sorted(found)[max(0, math.ceil(share * len(found)) - 1)] if found else math.nan


def table(head, rows):
    """Lines of columns as wide as their widest cell; the first is flush left, the others flush right."""
    cells = [[str(cell) for cell in row] for row in [head, *rows]]
    widths = [max(map(len, column)) for column in zip(*cells)]
    for row in cells:
        yield "  ".join(cell.ljust(width) if i == 0 else cell.rjust(width) for i, (cell, width) in enumerate(zip(row, widths))).rstrip()


@dataclass
class Bars:
    """Bars and what was measured; figures without a bar stand among them."""

    rows: list = field(default_factory=list)

    def hold(self, what, bar, measured, held):
        self.rows.append((what, bar, measured, "yes" if held else "NO"))

    def tell(self, what, measured):
        self.rows.append((what, "-", measured, "-"))

    def are_held(self):
        return all(row[3] != "NO" for row in self.rows)

    def close(self):
        """Prints the table and ends the tool, with status 1 where a bar is missed."""
        rows = [("what", "bar", "measured", "held"), *(tuple(map(str, row)) for row in self.rows)]
        wide, high = (max(len(row[i]) for row in rows) for i in (0, 1))
        print("\n".join(f"{what:{wide}}  {bar:>{high}}  {held:4}  {measured}" for what, bar, measured, held in rows))
        sys.exit(0 if self.are_held() else 1)
