"""Makes a failing case small: ddmin over its schedule, then fewer parts, then later onsets; one command that still fails."""
import itertools
import json
import pathlib
import tempfile

from . import oracle, vocabulary
from .jobs import Made
from .vocabulary import Fault

MOST_RUNS = 60
# onsets are moved to these grids, s, the coarsest that still fails
GRIDS_S = (1.0, 0.5, 0.1)


def ddmin(items, fails):
    """The smallest found sublist of `items` that still fails (Zeller's delta debugging, by complements)."""
    items, parts = list(items), 2
    while len(items) > 1:
        size = -(-len(items) // parts)
        chunks = [items[i : i + size] for i in range(0, len(items), size)]
        without = ([item for j, chunk in enumerate(chunks) if j != i for item in chunk] for i in range(len(chunks)))
        candidates = itertools.chain(chunks if len(chunks) > 2 else (), without)
        smaller = next((candidate for candidate in candidates if len(candidate) < len(items) and fails(candidate)), None)
        if smaller is not None:
            items, parts = smaller, max(2, min(parts - 1, len(smaller)))
        elif parts >= len(items):
            break
        else:
            parts = min(2 * parts, len(items))
    return items


def without_part(made, faults, index):
    """The case without one part, the faults renumbered; `None` where the task needs it."""
    job, task = made.job, made.job["task"]
    if made.parts < 2 or task["type"] not in ("arrange", "sort", "hold"):
        return None
    kinds = made.kinds
    # parts that start at random are drawn anew without the part: the command still has to fail in the same way
    rows = [row for row in job["parts"] for _ in range(row.get("count", 1))]
    parts = [{key: value for key, value in row.items() if key != "count"} for i, row in enumerate(rows) if i != index]
    task = dict(task)
    if "targets_mm" in task:
        task["targets_mm"] = [target for i, target in enumerate(task["targets_mm"]) if i != index]
    left = {kind for i, kind in enumerate(kinds) if i != index}
    if "bins" in task:
        bins = [dict(row, kinds=[kind for kind in row["kinds"] if kind in left]) for row in task["bins"]]
        task["bins"] = [row for row in bins if row["kinds"]]
    kept = [renumbered(fault, index) for fault in faults]
    if None in kept:
        return None
    return Made(made.template, made.rig, made.planner, dict(job, parts=parts, task=task)), kept


def renumbered(fault, index):
    """A fault as it is called without part `index`; `None` where it is that part's."""
    down = lambda part: part - (part > index)
    if fault.group == "part":
        part = int(fault.component[4:])
        return None if part == index else Fault(f"part{down(part)}", fault.kind, fault.value, fault.from_s, fault.to_s)
    if fault.name == "parts swapped":
        pair = tuple(float(down(int(v))) for v in fault.value)
        return None if index in map(int, fault.value) else Fault(fault.component, fault.kind, pair, fault.from_s, fault.to_s)
    return fault


def on_grid(fault, grid_s):
    """The fault with its onset on a grid, its end as far behind."""
    begin_s = round(round(fault.from_s / grid_s) * grid_s, 3)
    return Fault(fault.component, fault.kind, fault.value, begin_s, round(fault.to_s - fault.from_s + begin_s, 3))


class Shrinker:
    """Shrinks one case as long as the same rule is broken, within so many runs."""

    def __init__(self, fails, most_runs=MOST_RUNS):
        self.fails, self.left = fails, most_runs

    def still_fails(self, made, faults):
        self.left -= 1
        return self.left >= 0 and self.fails(made, faults)

    def shrink(self, made, faults):
        faults = ddmin(faults, lambda some: self.still_fails(made, some))
        part = 0
        while part < made.parts:
            smaller = without_part(made, faults, part)
            if smaller and self.still_fails(*smaller):
                made, faults = smaller
            else:
                part += 1
        for i in range(len(faults)):
            for grid_s in GRIDS_S:
                moved = faults[:i] + [on_grid(faults[i], grid_s)] + faults[i + 1 :]
                if moved != faults and self.still_fails(made, moved):
                    faults = moved
                    break
        return made, faults


def breaks(runner, rule, is_liveness, scratch):
    """A test that runs a case from the command line and tells whether it breaks the rule."""
    numbers = itertools.count()

    def fails(made, faults):
        folder, process = runner.run(made.job, faults, pathlib.Path(scratch) / str(next(numbers)), in_job=False)
        if folder is None:
            return any(violation.rule == rule for violation in oracle.process_faults(process))
        _, found = oracle.judge_folder(folder, process, is_liveness and bool(faults))
        return any(violation.rule == rule and not violation.is_unobservable for violation in found)

    return fails


def shrunk(runner, made, faults, rule, is_liveness, keep):
    """Lines that tell the smallest failing command; the job is written below `keep`."""
    if not faults:
        return ["nothing to shrink: the run has no faults"]
    if rule == "O10":
        return ["a run that does not repeat is not shrunk"]
    with tempfile.TemporaryDirectory(prefix="upm-shrink-") as scratch:
        fails = breaks(runner, rule, is_liveness, scratch)
        if not fails(made, faults):
            return ["does not fail with --faults on the command line: not shrunk"]
        shrinker = Shrinker(fails)
        made, faults = shrinker.shrink(made, faults)
    keep = pathlib.Path(keep or "target/faults")
    keep.mkdir(parents=True, exist_ok=True)
    file = keep / f"{made.job['name']}-shrunk.json"
    file.write_text(json.dumps(made.job, indent=1) + "\n")
    command = f"{runner.upm} run {file} --faults '{vocabulary.as_text(faults)}' --seed {made.job['seed']} --rerun off"
    return [f"smallest, {made.parts} part{'s' * (made.parts > 1)}, breaks {rule}:", command]
