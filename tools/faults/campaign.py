"""The campaign: schedules and jobs by seed on all cores, each run judged; what it prints."""
import argparse
import collections
import math
import pathlib
import random
import re
import shutil
import tempfile
import time
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, field

from common import table, upper_bound

from . import detection, drawn, jobs, oracle, vocabulary
from .shrink import shrunk

VERIFY_EVERY, NEXT_JOB_EVERY, TELL_EVERY_S = 100, 5, 5.0
# as in control/guards.rs, with pauses and without
PULSES_HZ, SEGMENTS_HZ = 3.0, 15.0


@dataclass(frozen=True)
class Case:
    """One draw: a job and its schedule."""

    seed: int
    made: jobs.Made
    faults: list
    is_liveness: bool


@dataclass
class Verdict:
    """Outcome and violations of a case."""

    case: Case
    outcome: str
    stop: str | None
    guards: list
    violations: list
    # names of the faults that began within the run
    begun: set
    wall_s: float
    told: str = ""
    # how near the run came to the findings that rest on chance
    evidence: dict = field(default_factory=dict)
    # bars that were missed: what switched-off guards are caught by, too
    missed: list = field(default_factory=list)


def case_of(seed, half="both"):
    """The job and schedule of a seed; every fourth job is drawn without a template."""
    rng = random.Random(seed)
    is_liveness = rng.random() < 0.5 if half == "both" else half == "liveness"
    made = drawn.make(rng, seed) if seed % 4 == 3 else jobs.make(rng, seed=seed)
    return Case(seed, made, vocabulary.drawn(rng, made.parts, is_liveness, made.end_s), is_liveness)


def healthy_case(seed, _):
    """A drawn job without faults; every tenth is the letters."""
    made = drawn.letters(seed) if seed % 10 == 0 else drawn.make(random.Random(seed), seed)
    return Case(seed, made, [], False)


def judged(runner, case, folder):
    """Runs a case and judges it, its next job and its repetition included."""
    run_folder, process = runner.run(case.made.job, case.faults, folder)
    if process.status == 2 or run_folder is None:
        said = process.stderr.strip()[:300]
        found = oracle.process_faults(process)
        if not case.faults or process.status != 2:
            found.append(oracle.Violation("O8" if not case.faults else "O6", f"no run, exit status {process.status}: {said}"))
        return Verdict(case, "refused", None, [], found, set(), process.wall_s, said)
    run, found = oracle.judge_folder(run_folder, process, case.is_liveness and bool(case.faults))
    if run is None:
        return Verdict(case, "unreadable", None, [], found, set(), process.wall_s, process.stderr.strip()[:300])
    # `upm verify` runs with all guards
    if case.seed % VERIFY_EVERY == 0 and not runner.without_guard:
        said = runner.verify(run_folder, case.made.job, folder)
        found += [oracle.Violation("O10", f"does not repeat: {said[:200]}")] if said else []
    if case.is_liveness and case.faults and case.seed % NEXT_JOB_EVERY == 0:
        found += next_job(runner, case, folder)
    begun = {fault.name for fault in run.fired()}
    guards = sorted({guard["code"] for guard in run.guards})
    verdict = Verdict(case, run.outcome, run.stop_code, guards, found, begun, process.wall_s, run.report["reason"])
    verdict.missed = list(missed_bars(run))
    verdict.evidence = run.report.get("evidence") or {}
    return verdict


def missed_bars(run):
    """Faults that were noticed too late or never."""
    for fault in run.fired():
        notice = detection.notice(run, fault)
        if notice and notice.is_missed:
            yield oracle.Violation(f"bar of {fault.name}", f"{fault} noticed {notice.code or 'never'}, {notice.text}")


def next_job(runner, case, folder):
    """O9: the same job without faults completes."""
    run_folder, _ = runner.run(case.made.job, [], pathlib.Path(folder) / "next")
    outcome = "refused" if run_folder is None else oracle.Run.read(run_folder).outcome
    return [] if outcome == "completed" else [oracle.Violation("O9", f"the next job, without faults, is {outcome}")]


@dataclass
class Campaign:
    """Runs cases and keeps their verdicts; `options` are those of the command line.

    With `options.sound`, a build with all guards, it ends with the first rule broken that is not broken there too.
    """

    runner: object
    options: argparse.Namespace
    draw: object = case_of
    verdicts: list = field(default_factory=list)

    def run(self):
        """All cases, told as they come; the folders of violations are kept when there is a place for them."""
        begin = told = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="upm-faults-") as scratch, ThreadPoolExecutor(self.options.jobs) as pool:
            first = self.options.first
            pending, seeds = set(), iter(range(first, first + self.options.seeds))
            while True:
                while len(pending) < 2 * self.options.jobs and not self.is_over():
                    seed = next(seeds, None)
                    if seed is None:
                        break
                    pending.add(pool.submit(self.one, seed, pathlib.Path(scratch) / str(seed)))
                if not pending:
                    break
                try:
                    done, pending = wait(pending, timeout=1.0, return_when=FIRST_COMPLETED)
                except KeyboardInterrupt:
                    print("interrupted: the runs that are under way are the last", flush=True)
                    done, seeds = set(), iter(())
                    pending = {future for future in pending if not future.cancel()}
                self.take([future.result() for future in done])
                if time.monotonic() - told > TELL_EVERY_S:
                    told = time.monotonic()
                    self.tell(told - begin)
        self.verdicts.sort(key=lambda verdict: verdict.case.seed)
        return time.monotonic() - begin

    def take(self, verdicts):
        """Keeps verdicts; what they violate is told at once."""
        self.verdicts += verdicts
        for verdict in verdicts:
            for violation in seen(verdict)[:1]:
                print(f"  seed {verdict.case.seed}: {violation}", flush=True)

    def is_over(self):
        return self.options.sound is not None and any(seen(verdict) for verdict in self.verdicts)

    def one(self, seed, folder):
        case = self.draw(seed, self.options.half)
        verdict = judged(self.runner, case, folder)
        if self.options.sound:
            verdict.violations += verdict.missed
        if verdict.violations and self.options.sound:
            sound = judged(self.options.sound, case, folder / "sound")
            broken = {violation.rule for violation in sound.violations + sound.missed}
            verdict.violations = [violation for violation in verdict.violations if violation.rule not in broken]
        if verdict.violations and self.options.keep:
            shutil.copytree(folder, self.options.keep / str(seed), dirs_exist_ok=True)
        shutil.rmtree(folder, ignore_errors=True)
        return verdict

    def tell(self, wall_s):
        bad = sum(bool(seen(verdict)) for verdict in self.verdicts)
        rate = len(self.verdicts) / wall_s
        print(f"{wall_s:7.0f} s  {len(self.verdicts)} runs, {rate:.1f} a second, {bad} with violations", flush=True)


def seen(verdict):
    """The violations that a picture could have shown."""
    return [violation for violation in verdict.violations if not violation.is_unobservable]


def report(verdicts, wall_s, runner, options):
    """Prints what a campaign found; true when nothing was violated."""
    bad = [verdict for verdict in verdicts if seen(verdict)]
    hidden = [verdict for verdict in verdicts if verdict.violations and not seen(verdict)]
    print(f"\n{len(verdicts)} runs in {wall_s:.0f} s, {sum(v.wall_s for v in verdicts) / max(len(verdicts), 1):.2f} s a run and core")
    print_violations(bad, runner, options)
    if hidden:
        seeds = ", ".join(f"seed {verdict.case.seed}" for verdict in hidden)
        print(f"\n{len(hidden)} false successes that no picture shows (equal parts exchanged between frames), counted apart: {seeds}")
    print_by_kind(verdicts)
    print_needless(verdicts)
    refused = print_refused(verdicts)
    count = len(verdicts) - refused
    print(f"\n{len(bad)} of {count} runs violate a rule; rate at most {upper_bound(len(bad), count):.1e} (95 %). O7 needs a daemon: `faults.py daemon`.")
    return not bad and not refused


def report_healthy(verdicts, wall_s):
    """Prints how healthy runs ended; true when no finding ended or slowed one and no rule was broken."""
    rows = []
    for kind in sorted({(v.case.made.template, v.case.made.planner) for v in verdicts}):
        of = [v for v in verdicts if (v.case.made.template, v.case.made.planner) == kind]
        ends = collections.Counter(v.stop or v.outcome for v in of if v.outcome != "completed")
        told = collections.Counter(code for v in of for code in v.guards)
        rows.append([*kind, len(of), sum(v.outcome == "completed" for v in of), in_words(told), in_words(ends)])
    print("\n".join(table(["job", "planner", "runs", "completed", "findings", "other ends"], rows)))
    print_tails(verdicts)
    bad = [v for v in verdicts if v.guards or v.violations or v.outcome != "completed"]
    for v in bad:
        print(f"  seed {v.case.seed}  {v.case.made.template}, {v.case.made.parts} parts, {v.case.made.planner}: {v.told}")
    print(f"\n{len(bad)} of {len(verdicts)} healthy runs in {wall_s:.0f} s; rate at most {upper_bound(len(bad), len(verdicts)):.1e} (95 %)")
    return not bad


def print_tails(verdicts):
    """Tails of the evidence of healthy runs, exponential in their largest tenth, and the false alarms that follow from them.

    A value `once + per_nat n` is exceeded in one pulse of `e^n`: the figures of `control/guards.rs`.
    """
    rows = []
    for name, hz in (("with pauses", PULSES_HZ), ("without", SEGMENTS_HZ)):
        runs = [v.evidence for v in verdicts if v.evidence and (v.case.made.planner == "moving_field") == (name == "without")]
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
    print("\n" + "\n".join(table(["evidence", "pulses", "runs", "number", "once", "per nat", "most", "limit", "alarms in 1,000 h"], rows)))
    steps, missed = (sum(v.evidence[key] for v in verdicts if v.evidence) for key in ("steps", "steps_missed"))
    print(f"{steps} steps of parts, {missed} of them missed")


def print_violations(bad, runner, options):
    if not bad:
        return
    rules = collections.Counter(violation.rule for verdict in bad for violation in seen(verdict))
    print(f"\nviolations: {', '.join(f'{rule} {count}' for rule, count in sorted(rules.items()))}")
    for verdict in bad:
        case = verdict.case
        print(f"  seed {case.seed}  {case.made.template}, {case.made.rig}, {case.made.planner}; {verdict.outcome}, {verdict.stop or 'no stop'}")
        print(f"    --faults '{vocabulary.as_text(case.faults)}'")
        for violation in seen(verdict):
            print(f"    {violation}")
        if not options.no_shrink:
            for line in shrunk(runner, case.made, case.faults, seen(verdict)[0].rule, case.is_liveness, options.keep):
                print(f"    {line}", flush=True)


def print_by_kind(verdicts):
    outcomes, codes = collections.defaultdict(collections.Counter), collections.defaultdict(collections.Counter)
    for verdict in verdicts:
        for name in verdict.begun or {"no fault began"}:
            outcomes[name][verdict.outcome] += 1
            codes[name].update(verdict.guards)
    print("\noutcomes and guards by kind of fault (a run counts for each of its faults)")
    heads = ("completed", "failed", "cancelled", "unreadable")
    rows = [[name, *(outcomes[name][head] or "." for head in heads), in_words(codes[name])] for name in sorted(outcomes)]
    print("\n".join(table(["fault", *heads, "guards"], rows)))


def in_words(counter):
    return ", ".join(f"{code} {count}" for code, count in counter.most_common()) or "-"


def print_needless(verdicts):
    """Stops of runs in which every fault was one that a run has to get over, or none began."""
    mild = [v for v in verdicts if v.outcome != "refused" and (not v.begun or all(map(vocabulary.harmless, v.case.faults)))]
    needless = [verdict for verdict in mild if verdict.outcome != "completed"]
    print(f"\nharmless faults or none: {len(mild)} runs, {len(needless)} needless stops")
    for verdict in needless:
        print(f"  seed {verdict.case.seed}  {verdict.stop or verdict.told}: {vocabulary.as_text(verdict.case.faults)}")


def print_refused(verdicts):
    """How many runs were refused: the draw knows what a job may hold, so none should be."""
    said = collections.Counter(re.sub(r"\S*/job\.json: ", "", v.told) for v in verdicts if v.outcome == "refused")
    for text, count in said.most_common(5):
        print(f"\nrefused: {count} x {text}")
    return sum(said.values())
