"""Makes a failing case small: ddmin over its schedule; one command that still fails."""
import itertools
import json
import pathlib
import tempfile

from . import oracle, vocabulary

MOST_RUNS = 60


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


def shrunk(runner, made, faults, rule, is_liveness, keep):
    """Lines that tell the smallest failing command; the job is written below `keep`."""
    if not faults:
        return ["nothing to shrink: the run has no faults"]
    if rule == "O10":
        return ["a run that does not repeat is not shrunk"]
    with tempfile.TemporaryDirectory(prefix="upm-shrink-") as scratch:
        numbers = iter(range(MOST_RUNS))

        def fails(some):
            """True when a run with these faults, from the command line, breaks the rule."""
            number = next(numbers, None)
            if number is None:
                return False
            folder, process = runner.run(made.job, some, pathlib.Path(scratch) / str(number), in_job=False)
            if folder is None:
                return any(violation.rule == rule for violation in oracle.process_faults(process))
            _, found = oracle.judge_folder(folder, process, is_liveness and bool(some))
            return any(violation.rule == rule and not violation.is_unobservable for violation in found)

        if not fails(faults):
            return ["does not fail with --faults on the command line: not shrunk"]
        faults = ddmin(faults, fails)
    keep = pathlib.Path(keep or "target/faults")
    keep.mkdir(parents=True, exist_ok=True)
    file = keep / f"{made.job['name']}-shrunk.json"
    file.write_text(json.dumps(made.job, indent=1) + "\n")
    command = f"{runner.upm} run {file} --faults '{vocabulary.as_text(faults)}' --seed {made.job['seed']} --rerun off"
    return [f"fewest faults, breaks {rule}:", command]
