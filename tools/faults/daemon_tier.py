"""The daemon tier: the 55 schedules as jobs of one daemon, each with a job queued behind it, and emergency stops in faults.

Judges O7 (plates pause), O9 (the next job completes on the same plate), O10 (the daemon's run is the run of `upm run`) and
O5 after an emergency stop. The rules are in pausing.py.
"""
import collections
import itertools
import json
import pathlib
import queue
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from common import table
from upm_daemon import DaemonFault

from . import jobs, oracle, pausing, schedules
from .oracle import Violation
from .pausing import End, Left, Stop
from .runs import allowed_s
from .served import Served
from .vocabulary import Fault

# a plate that may move looks for work at least once a second: a job that is still queued after this is held back
HELD_S = 1.3
NEXT_S, MOST_PLATES, TOLD_CASES = 60.0, 16, 6
NEXT_JOB = {
    "name": "next", "seed": 1, "parts": [{"kind": "penny", "position_mm": [0, 0]}],
    "task": {"type": "arrange", "targets_mm": [[6, 0]]}, "tolerance_mm": 0.5, "limits": {"plate_time_s": 20},
}  # fmt: skip
# schedules under which a run goes on for a second and more, and the plate time of the emergency stop, s
ESTOPS = {
    "camera:freeze@0.5": 1.2,
    "view:hand=0.33@0.5": 1.5,
    "camera:drop=0.9@0": 0.6,
    "light:flicker=7@0": 0.8,
    "coil0:gain=0.85@0": 0.7,
    "part0:moved=8;5@0.5": 0.9,
    "device:deaf@0.3": 0.8,
    "device:hang=0.1@0.3": 0.8,
}
ESTOP_JOB = "arr4"
ROW = ("schedule", "job", "seed", "alone", "in the daemon", "plate", "its cause", "next job", "at last", "violations")


@dataclass(frozen=True)
class Case:
    """One schedule in one job and seed."""

    name: str
    template: str
    seed: int
    made: jobs.Made
    faults: list

    @classmethod
    def of(cls, name, text, template, seed):
        return cls(name, template, seed, schedules.made_for(template, seed), [Fault.parse(part) for part in text.split(",")])

    @property
    def rig(self):
        """The name of the plates that take it: a rig, and the size of its camera."""
        is_small = self.made.job["rig"]["camera"] != jobs.RIGS[self.made.rig]["camera"]
        return self.made.rig + ("-small" if is_small else "")

    @property
    def head(self):
        return [self.name, self.template, self.seed]


@dataclass
class Verdict:
    """A row of a table and the violations of a case."""

    case: Case
    row: list
    violations: list
    has_paused: bool = False
    had_to_pause: bool = False


@dataclass
class Tier:
    """Runs cases on one daemon, each on a plate that nothing else uses meanwhile."""

    runner: object
    daemon: Served
    scratch: pathlib.Path
    free: dict = field(default_factory=dict)

    def judged(self, does, case):
        """The verdict of `does` on a free plate; a daemon that does not answer in time is a violation."""
        plate = self.free[case.rig].get()
        try:
            verdict = does(case, plate)
        except DaemonFault as fault:
            verdict = Verdict(case, case.head, [Violation("O6", str(fault))])
        finally:
            try:
                self.daemon.restore(plate)
            except DaemonFault as fault:
                verdict.violations.append(Violation("O6", f"the plate cannot be restored: {fault}"))
            self.free[case.rig].put(plate)
        verdict.row += ["-"] * (len(ROW) - 1 - len(verdict.row))
        verdict.row.append(" ".join(sorted({violation.rule for violation in verdict.violations})) or "-")
        return verdict

    def faulty(self, case, plate):
        """A job with faults, and a job without any behind it."""
        alone = self.alone(case)
        answer = self.daemon.send(case.made.job, plate, case.faults)
        if answer.status != 201:
            return self.refused(case, answer)
        behind = self.next_on(plate)
        job = self.daemon.ended(answer.json()["id"], allowed_s(case.made.job))
        end = End.of_report(job["state"], job["report"])
        left = self.left(plate, behind)
        found = pausing.violations(alone, end, left)
        is_paused = left.plate["state"] == "paused"
        row = [*case.head, timed(alone), timed(end), "paused" if is_paused else "goes on", *row_end(left)]
        return Verdict(case, row, found, is_paused, pausing.must_pause(end))

    def refused(self, case, answer):
        refusal = Violation("O6", f"refused, status {answer.status}: {answer.words()}")
        return Verdict(case, [*case.head, "-", "refused"], [refusal])

    def alone(self, case):
        """The end of the same job by `upm run`."""
        folder = self.scratch / "-".join(map(str, case.head)).replace(" ", "-").replace("/", "-")
        run_folder = self.runner.run(case.made.job, case.faults, folder)
        if run_folder is None:
            return End("refused")
        try:
            report = json.loads((run_folder / "report.json").read_text())
        except (OSError, ValueError):
            return End("unreadable")
        return End.of_report(report["outcome"], report)

    def next_on(self, plate):
        """The id of a job without faults, queued on a plate."""
        return self.daemon.submit(NEXT_JOB | {"plate": plate}, "max")["id"]

    def left(self, plate, behind):
        """Looks at plate and queue after an end, then resumes the plate where it is paused."""
        seen = self.daemon.plate(plate)
        if seen["state"] != "paused":
            job = self.daemon.ended(behind, NEXT_S)
            return Left(seen, job["state"], End.of_report(job["state"], job["report"]))
        time.sleep(HELD_S)
        waiting = self.daemon.job(behind)["state"]
        resumed = self.daemon.resume(plate)
        job = self.daemon.ended(behind, NEXT_S)
        return Left(seen, waiting, End.of_report(job["state"], job["report"]), resumed)

    def stopped(self, case, plate):
        """A run that an emergency stop ends, a reset and a resume; in real time, for the stop to come within the run."""
        answer = self.daemon.send(case.made.job, plate, case.faults, "real-time")
        if answer.status != 201:
            return self.refused(case, answer)
        behind, id, most_s = self.next_on(plate), answer.json()["id"], allowed_s(case.made.job)
        if not self.is_stop_due(plate, id, behind, ESTOPS[case.name], most_s):
            job = self.daemon.ended(id, most_s)
            end = End.of_report(job["state"], job["report"])
            early = Violation("O10", f"{end} before the emergency stop was due")
            return Verdict(case, [*case.head, "-", timed(end)], [early])
        answer = self.daemon.act(plate, "estop")
        job = self.daemon.ended(id, most_s)
        held = self.daemon.plate(plate)
        refused = self.daemon.resume(plate), self.daemon.send(NEXT_JOB, plate).status
        self.daemon.reset(plate, "the run was stopped on purpose")
        end, left = End.of_report(job["state"], job["report"]), self.left(plate, behind)
        stop = Stop(answer, refused, held, case.made.job["rig"]["simulation"]["step_s"], self.pulses_s(id))
        found = pausing.estop_violations(end, stop, left)
        asked_s, silent_s = (answer.get(key) or 0.0 for key in ("requested_at_s", "silent_at_s"))
        times = f"{asked_s:.3f} s, silent {(silent_s - asked_s) * 1e6:.0f} us later"
        row = [*case.head, times, timed(end), f"{held['state']}, {left.plate['state']}", *row_end(left)]
        return Verdict(case, row, found)

    def is_stop_due(self, plate, id, behind, at_s, most_s):
        """Waits for a plate time of a job; false when the job has ended before."""

        def look():
            seen = self.daemon.plate(plate)
            is_there = seen["job"] == id and seen["at_s"] >= at_s
            return ("due" if is_there else "over") if is_there or seen["state"] == "paused" or seen["job"] == behind else None

        return self.daemon.wait_for("the plate time of the emergency stop", look, most_s) == "due"

    def pulses_s(self, id):
        """Starts of the pulses of a job, s."""
        try:
            return tuple(pulse.start_s for pulse in oracle.Run.read(self.daemon.run_folders(id)[0]).pulses)
        except (OSError, ValueError, LookupError, TypeError) as fault:
            raise DaemonFault(f"no complete run folder: {type(fault).__name__} {fault}") from fault


def timed(end):
    return f"{end} {end.at_s:.2f} s" if end.at_s is not None else str(end)


def row_end(left):
    """Columns of a row: cause of the pause, the next job before the plate is resumed, and at last."""
    cause = left.plate.get(pausing.PAUSE)
    code = cause.get("code") if isinstance(cause, dict) else None
    return [code or "-", left.waiting, left.next]


def cases_of(jobs_per, seeds, only):
    """Every schedule in so many jobs and seeds."""
    names = schedules.chosen(schedules.SCHEDULES, only)
    wanted = itertools.product(names, schedules.JOBS[:jobs_per], range(1, seeds + 1))
    return [Case.of(name, schedules.SCHEDULES[name], template, seed) for name, template, seed in wanted]


def plates_for(cases, at_once):
    """Plates by name, with their rigs, and the free ones of each rig."""
    rigs = {case.rig: case.made.job["rig"] for case in cases}
    each = max(1, min(at_once, MOST_PLATES // len(rigs)))
    free = {name: queue.Queue() for name in rigs}
    plates = {f"{name}-{number}": rigs[name] for name in rigs for number in range(1, each + 1)}
    for plate in plates:
        free[plate.rpartition("-")[0]].put(plate)
    return plates, free


def run_all(runner, jobs_per, seeds, at_once, only=None, estops=True):
    """Runs all cases and prints a row each; true when no rule is broken."""
    cases = cases_of(jobs_per, seeds, only)
    stops = [Case.of(text, text, ESTOP_JOB, 1) for text in schedules.chosen(ESTOPS, only)] if estops else []
    if not cases + stops:
        raise SystemExit(f"expected words of the names of schedules, found none with {', '.join(only)}")
    plates, free = plates_for(cases + stops, at_once)
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="upm-daemon-") as scratch, Served(runner.upm, scratch, plates) as daemon:
        tier = Tier(runner, daemon, pathlib.Path(scratch) / "alone", free)
        with ThreadPoolExecutor(at_once) as pool:
            work = [(tier.faulty, case) for case in cases] + [(tier.stopped, case) for case in stops]
            verdicts = []
            for verdict in pool.map(lambda one: tier.judged(*one), work):
                verdicts.append(verdict)
                if len(verdicts) % 15 == 0:
                    bad = sum(bool(v.violations) for v in verdicts)
                    print(f"{len(verdicts)} of {len(work)} jobs, {bad} with violations", flush=True)
        daemon_faults = faults_of(daemon)
    return report(verdicts[: len(cases)], verdicts[len(cases) :], daemon_faults, time.monotonic() - begin)


def faults_of(daemon):
    """O6: the daemon answers to the end, and nothing in it panics."""
    found, log = [], daemon.said()
    try:
        answer = daemon.ask("GET", "/healthz")
        if answer.status != 200:
            found.append(Violation("O6", f"the daemon is not well: {answer.words()}"))
    except DaemonFault as fault:
        found.append(Violation("O6", str(fault)))
    if "panicked at" in log:
        found.append(Violation("O6", f"panic: {log[log.index('panicked at'):][:160]}"))
    return found


def report(faulty, stopped, daemon_faults, wall_s):
    """Prints both tables, then the violations, each with the jobs that have it."""
    if faulty:
        print("\n".join(table(ROW, [verdict.row for verdict in faulty])))
    if stopped:
        print("\nemergency stops in the middle of a run; the plate until the reset, and after it")
        print("\n".join(table([*ROW[:3], "stop asked", *ROW[4:]], [verdict.row for verdict in stopped])))
    due, paused = sum(v.had_to_pause for v in faulty), sum(v.has_paused for v in faulty)
    print(f"\n{len(faulty)} jobs with faults and {len(stopped)} emergency stops in {wall_s:.0f} s")
    print(f"{due} ends have to pause the plate, {paused} ends paused it")
    verdicts = faulty + stopped
    bad = [verdict for verdict in verdicts if verdict.violations]
    print(f"{len(bad)} of {len(verdicts)} break a rule")
    print_violations(bad, daemon_faults)
    return not bad and not daemon_faults


def print_violations(bad, daemon_faults):
    by_text = collections.defaultdict(list)
    for verdict in bad:
        for text in dict.fromkeys(map(str, verdict.violations)):
            by_text[text].append(", ".join([*verdict.case.head[:2], f"seed {verdict.case.seed}"]))
    for violation in daemon_faults:
        by_text[str(violation)].append("the daemon")
    for text, names in sorted(by_text.items()):
        more = f"; and {len(names) - TOLD_CASES} more" if len(names) > TOLD_CASES else ""
        print(f"  {text}\n    {len(names)} x: {'; '.join(names[:TOLD_CASES])}{more}")
