"""O7, O9 and O10 in a daemon: the state in which the end of a job, or an emergency stop, leaves its plate.

The contract is that of docs/faults.md: every end by a guard or the time limit pauses the plate, which tells the cause and
the remedy (`pause`: null while it is not paused); the next job is not taken up until a person resumes the plate. The rules
share no code with the program.
"""
from dataclasses import dataclass, field

from .oracle import Violation

PAUSE = "pause"
# ends of a run that is not completed, and in which no guard found anything: another job came, the planner has no way, or
# the run was stopped from outside
GOES_ON = (
    "gave_way", "no_feasible_step", "parts_hinder", "uncontrollable", "stopped", "interrupted", "cancelled", "estop", "shutdown", "journal_lost",
)  # fmt: skip
# plate times of one simulated run on its own and in a daemon agree to this, s: the same pace, the same bytes
SAME_S = 1e-6


@dataclass(frozen=True)
class End:
    """How a run ended: state of the job or outcome of the run, stop code, plate time."""

    state: str
    code: str | None = None
    at_s: float | None = None

    @classmethod
    def of_report(cls, state, report):
        report = report or {}
        return cls(state, (report.get("stop") or {}).get("code"), report.get("plate_time_s"))

    def __str__(self):
        return self.code or (self.state if self.state in ("completed", "cancelled") else f"{self.state}, no code")


@dataclass(frozen=True)
class Left:
    """Plate and queue after the end of a job: once before and once after a person resumes the plate."""

    plate: dict
    # state of the job behind it: after the time in which a plate that may move takes a job, and at last
    waiting: str
    next: End
    # status of the answer to `resume`; `None` where the plate was not paused
    resumed: int | None = None


@dataclass(frozen=True)
class Stop:
    """An emergency stop in the middle of a run."""

    # the answer of `estop`, the statuses of `resume` and of a job sent while the stop holds, the plate by then
    answer: dict
    refused: tuple
    held: dict
    # one step of the simulated rig
    step_s: float
    # starts of the pulses of the run, s
    pulses_s: tuple = field(default_factory=tuple)


def must_pause(end):
    """True where a person has to look before the plate takes another job. A code that is not known pauses."""
    if end.state == "completed" or end.code in GOES_ON:
        return False
    return end.code is not None or end.state != "cancelled"


def violations(alone, end, left):
    """Violations of a job with faults; `alone` is the end of the same job, seed and faults by `upm run`."""
    rules = [of_end(end), of_plate(end, left), of_next(left), of_repetition(alone, end)]
    return [Violation(*row) for rule in rules for row in rule]


def of_end(end):
    """O7: a run that is not completed, and that no person ended, names its cause."""
    if must_pause(end) and not end.code:
        yield "O7", f"{end.state} without a stop code"


def of_plate(end, left):
    """O7: the plate pauses exactly where a person has to look, and tells why and what to check."""
    is_paused = left.plate["state"] == "paused"
    if is_paused != must_pause(end):
        yield "O7", f"{'paused' if is_paused else 'not paused'} after {end}"
    if is_paused and must_pause(end):
        yield from of_cause(left.plate, "paused", end.code)


def of_cause(plate, how, code=None):
    """The cause that a paused plate tells; `code` is the stop code of the job, `None` where it has none."""
    cause = plate.get(PAUSE)
    if not isinstance(cause, dict):
        yield "O7", f"the {how} plate has no `{PAUSE}` with `code` and `remedy`"
        return
    told = cause.get("code")
    if not told or (code and told != code):
        yield "O7", f"`{PAUSE}.code` of the {how} plate is {told}, `stop.code` of the job is {code}"
    if not str(cause.get("remedy") or "").strip():
        yield "O7", f"`{PAUSE}.remedy` of the {how} plate is empty after {told}"


def of_next(left):
    """O7 and O9: the job behind waits for a person while the plate is paused, and completes afterwards."""
    if left.plate["state"] == "paused":
        if left.waiting != "queued":
            yield "O7", f"the next job is {left.waiting} before the plate is resumed"
        if left.resumed != 200:
            yield "O9", f"the paused plate is not resumed: status {left.resumed}"
    if left.next.state != "completed":
        yield "O9", f"the next job, without faults, is {left.next.state}: {left.next}"


def of_repetition(alone, end):
    """O10: the daemon neither ends a run otherwise than its guards do nor at another time."""
    if (alone.state, alone.code) != (end.state, end.code):
        yield "O10", f"{end} in the daemon, {alone} alone"
    elif None not in (alone.at_s, end.at_s) and abs(alone.at_s - end.at_s) > SAME_S:
        yield "O10", f"{end} in the daemon at another plate time than alone"


def estop_violations(end, stop, left):
    """Violations of a run that an emergency stop ended."""
    rules = [of_silence(stop), of_stop(end, stop), of_reset(left), of_next(left)]
    return [Violation(*row) for rule in rules for row in rule]


def of_silence(stop):
    """O5: no force later than one step after the stop, and no pulse afterwards."""
    answer = stop.answer
    if not (answer.get("silent") and answer.get("persisted")):
        yield "O5", f"emergency stop: silent {answer.get('silent')}, persisted {answer.get('persisted')}"
        return
    late_s = answer["silent_at_s"] - answer["requested_at_s"]
    if late_s > stop.step_s * (1 + 1e-6):
        late_us, bar_us = late_s * 1e6, stop.step_s * 1e6
        yield "O5", f"motors are silent {late_us:.0f} us after the emergency stop, bar one step of {bar_us:.0f} us"
    if any(start_s > answer["silent_at_s"] for start_s in stop.pulses_s):
        yield "O5", "a pulse starts after the emergency stop"


def of_stop(end, stop):
    """O7: the job is cancelled; the plate takes none, and no `resume`, until a person resets it."""
    if end.state != "cancelled":
        yield "O7", f"{end} after an emergency stop, not cancelled"
    if stop.held["state"] != "stopped":
        yield "O7", f"the plate is {stop.held['state']} after an emergency stop"
    for what, status in zip(("resume", "a new job"), stop.refused):
        if status != 409:
            yield "O7", f"{what} is answered with {status} while the emergency stop holds, not with 409"


def of_reset(left):
    """O7: a reset moves nothing: the plate is paused by it."""
    if left.plate["state"] != "paused":
        yield "O7", f"the plate is {left.plate['state']} after the reset, not paused"
    else:
        yield from of_cause(left.plate, "reset")
