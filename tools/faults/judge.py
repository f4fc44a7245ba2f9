"""Judges run folders for `upm campaign --judge`, and counts what healthy runs were near to."""
import json
import math
import pathlib
import re
import sys
import tempfile

from common import table

from . import detection, oracle, vocabulary

VERIFY_EVERY, NEXT_JOB_EVERY = 100, 5
# as in control/guards.rs, with pauses and without
PULSES_HZ, SEGMENTS_HZ = 3.0, 15.0


def answer(runner, wants_bars):
    """A line of violations for each folder that is named on standard input."""
    for line in sys.stdin:
        folder = pathlib.Path(line.strip())
        number = re.search(r"-run-(\d+)$", folder.name)
        violations = of_folder(runner, folder, int(number[1]) if number else None, wants_bars)
        print(json.dumps({"violations": [str(violation) for violation in violations]}), flush=True)


def of_folder(runner, folder, number=None, wants_bars=False):
    """What breaks a rule in a run; of some numbers its repetition and its next job, too.

    What no picture shows (equal parts exchanged between frames) is told on standard error.
    """
    run, found = oracle.judge_folder(folder)
    for violation in found:
        if violation.is_unobservable:
            print(f"{folder.name}: no picture shows it: {violation}", file=sys.stderr)
    found = [violation for violation in found if not violation.is_unobservable]
    if run is None:
        return found
    mild = run.fired() and all(map(vocabulary.harmless, run.faults))
    if mild and run.outcome != "completed":
        found.append(oracle.Violation("needless", f"{run.stop_code or run.outcome} although every fault is harmless"))
    with tempfile.TemporaryDirectory(prefix="upm-judge-") as scratch:
        if number and number % VERIFY_EVERY == 0:
            said = runner.verify(folder, run.job)
            found += [oracle.Violation("O10", f"does not repeat: {said[:200]}")] if said else []
        if number and number % NEXT_JOB_EVERY == 0 and run.faults and oracle.ends_its_faults(run):
            next_folder = runner.run(run.job | {"faults": []}, [], scratch)
            outcome = "refused" if next_folder is None else oracle.Run.read(next_folder).outcome
            if outcome != "completed":
                found.append(oracle.Violation("O9", f"the next job, without faults, is {outcome}"))
    return found + (list(missed_bars(run)) if wants_bars else [])


def missed_bars(run):
    """Faults that were noticed too late or never."""
    for fault in run.fired():
        notice = detection.notice(run, fault)
        if notice and notice.is_missed:
            yield oracle.Violation("bar", f"{fault} noticed {notice.code or 'never'}, {notice.text}")


def lines_of(folder):
    """The lines of a campaign's folder, in the order of their runs."""
    lines = (json.loads(line) for path in pathlib.Path(folder).glob("shard-*.jsonl") for line in path.read_text().splitlines())
    return sorted(lines, key=lambda line: line["run"])


def print_tails(folder):
    """Tails of the evidence of healthy runs, exponential in their largest tenth, and the false alarms that follow from them.

    A value `once + per_nat n` is exceeded in one pulse of `e^n`: the figures of `control/guards.rs`.
    """
    rows, all_of = [], [line["evidence"] for line in lines_of(folder) if line.get("evidence")]
    for name, hz in (("with pauses", PULSES_HZ), ("without", SEGMENTS_HZ)):
        # segments have a limit of their own, which is lower
        widest = max(run["motion_limit"] for run in all_of)
        runs = [run for run in all_of if (run["motion_limit"] < widest) == (name == "without")]
        for kind in ("motion", "late"):
            peaks, pulses = sorted(run[kind] for run in runs), sum(run["pulses"] for run in runs)
            above = peaks[int(0.9 * len(peaks)) :]
            per_nat = sum(above) / len(above) - above[0] if above else 0.0
            if per_nat <= 0.0:
                continue
            once, limit = above[0] - per_nat * math.log(pulses / len(above)), min(run[f"{kind}_limit"] for run in runs)
            alarms = hz * 3.6e6 * math.exp((once - limit) / per_nat)
            figures = [f"{figure:.3f}" for figure in (once, per_nat, peaks[-1], limit)]
            rows.append([kind, name, len(runs), pulses, *figures, f"{alarms:.1e}"])
    print("\n".join(table(["evidence", "pulses", "runs", "number", "once", "per nat", "most", "limit", "alarms in 1,000 h"], rows)))
    steps, missed = (sum(run[key] for run in all_of) for key in ("steps", "steps_missed"))
    print(f"{steps} steps of parts, {missed} of them missed")
