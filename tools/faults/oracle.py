"""The judge of a run: the rules O1 to O9 over `effective.json`, `journal.jsonl`, `report.json` and `truth.jsonl`.

Shares no code with the program that it judges. O1 is in claims.py, O2 in detection.py and actuators.py, O4 in progress.py, O7
in pausing.py; O9's next job and O10's repetition are runs of their own, see judge.py.
"""
import bisect
import json
import pathlib
from dataclasses import dataclass, field

from . import actuators, claims, detection, progress
from .vocabulary import LIVENESS_END_S, Fault, is_blinding

# a plate that stuck coils held off its place swings for so long once they let it go
SWINGS_OUT_S = 4.0
STUCK = ("coils stuck", "coil stuck")
NAMED_WITHIN_S = 0.5
# a run may wait so long for a hand to go
OVER_LIMIT_S = 12.0
# findings that are told once when they begin, and may end the run much later
TOLD_FIRST = ("coil_fault", "motion_off", "accelerometer_fault", "camera_moved", *actuators.BLIND_CODES)


@dataclass(frozen=True)
class Violation:
    """A rule that a run broke."""

    rule: str
    text: str
    # no picture can show what happened: counted apart
    is_unobservable: bool = False

    def __str__(self):
        return f"{self.rule}: {self.text}"


@dataclass
class Pulse:
    """One pulse as the journal has it; times s."""

    start_s: float
    attack_s: float
    sustain_s: float
    rest_s: float
    base_hz: float
    # for each coil: root of the sum of squares over its harmonics, counts, and the harmonics themselves
    counts: list
    # the look that it was planned from: time and places, mm
    seen_at_s: float = 0.0
    seen_mm: list = field(default_factory=list)
    # the small pulse at the beginning, which no look leads to and which moves no part
    is_probe: bool = False
    cycle: int = 0

    @property
    def end_s(self):
        return self.start_s + 2 * self.attack_s + self.sustain_s + self.rest_s


@dataclass
class Run:
    """A run folder, read."""

    job: dict
    report: dict
    cycles: list
    pulses: list
    localised: list
    # looks from nothing before a goal counts as reached
    confirmed: list
    faults: list
    # (time, [(x, y, on the plate)]), mm, one a camera frame; empty in a run without faults
    truth: list = field(default_factory=list)

    @classmethod
    def read(cls, folder):
        folder = pathlib.Path(folder)
        effective, report = (json.loads((folder / name).read_text()) for name in ("effective.json", "report.json"))
        lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines() if line]
        cycles = [line for line in lines if line["type"] == "cycle"]
        path, truth = folder / "truth.jsonl", []
        if path.exists():
            rows = (json.loads(line) for line in path.read_text().splitlines() if line)
            truth = [(row["at_s"], [tuple(part) for part in row["parts"]]) for row in rows]
        rows = effective["job"].get("faults") or []
        # a job that names a seed has its schedule drawn by the program, which reports it
        rows = rows if isinstance(rows, list) else report.get("faults") or []
        localised, confirmed = ([line for line in lines if line["type"] == kind] for kind in ("localised", "confirmed"))
        return cls(effective["job"], report, cycles, pulses_of(lines), localised, confirmed, [Fault.of(row) for row in rows], truth)

    @property
    def end_s(self):
        return self.report["plate_time_s"]

    @property
    def is_moving(self):
        return (self.report.get("planner") or {}).get("name") == "moving_field"

    @property
    def outcome(self):
        return self.report["outcome"]

    @property
    def stop_code(self):
        return (self.report.get("stop") or {}).get("code")

    @property
    def guards(self):
        return self.report.get("guards") or []

    @property
    def tolerance_mm(self):
        return self.job["tolerance_mm"]

    @property
    def frame_s(self):
        return 1.0 / self.job["rig"]["camera"]["frame_hz"]

    def fired(self):
        """Faults that began within the run; one may end it in the moment of its onset."""
        return [fault for fault in self.faults if fault.from_s <= self.end_s]

    def truth_at(self, at_s):
        """Where the parts truly were in the last frame up to `at_s`; `None` without truth."""
        after = bisect.bisect_right(self.truth, at_s + 1e-6, key=lambda row: row[0])
        return self.truth[max(after - 1, 0)][1] if self.truth else None

    def final_truth(self):
        """The last known true places, from the truth or, without one, from the report."""
        if self.truth:
            return self.truth[-1][1]
        parts = [part.get("true_mm") for part in self.report["parts"]]
        return [(*at, 1) for at in parts] if parts and all(parts) else None

    def clear_by(self, at_s, within_s, hides=is_blinding):
        """The time by which the plate could be seen for `within_s` on end, from `at_s` on; late pictures come later."""
        begin_s = at_s
        for fault in sorted(filter(hides, self.faults), key=lambda fault: fault.from_s):
            end_s = fault.to_s + (SWINGS_OUT_S if fault.name in STUCK else 0.0)
            if fault.from_s <= begin_s + within_s and end_s > begin_s:
                begin_s = end_s
        late = (f.value[0] for f in self.faults if f.name == "camera late" and f.from_s <= at_s + within_s and f.to_s > at_s)
        return begin_s + within_s + self.frame_s * (1 + max(late, default=0))


def pulses_of(lines):
    """All pulses in order, each with the look that it was planned from."""
    pulses, seen = [], (0.0, [])
    for line in lines:
        if line["type"] == "localised":
            seen = line["at_s"], [part["position_mm"] for part in line["parts"]]
        if line["type"] == "cycle":
            seen = line["observed_at_s"], line["observed_mm"]
        for row in line.get("sent", ()):
            counts = [[value for harmonic in coil for value in harmonic] for coil in row["counts"]]
            times = (row[key] for key in ("started_at_s", "attack_s", "sustain_s", "rest_s", "base_hz"))
            pulses.append(Pulse(*times, counts, *seen, row.get("probe", False), line["cycle"]))
        if line["type"] == "cycle":
            # a cycle that never ends is planned from the end of the one before
            seen = line["ended_at_s"], line["result_mm"]
    return sorted(pulses, key=lambda pulse: pulse.start_s)


def judge(run):
    """Every violation of a run."""
    rules = [claims.violations(run), detection.violations(run), unnamed_losses(run), progress.violations(run)]
    rules += [after_the_end(run), resources(run), false_alarms(run)]
    if ends_its_faults(run):
        rules.append(untyped_end(run))
    return [Violation(*row) for rule in rules for row in rule]


def ends_its_faults(run):
    """True when there are faults, and all of them are over by five seconds."""
    return run.faults and all(fault.to_s <= LIVENESS_END_S for fault in run.faults)


def judge_folder(folder):
    """The run and its violations; a folder that cannot be read is one."""
    try:
        run = Run.read(folder)
    except (OSError, ValueError, KeyError, TypeError) as fault:
        return None, [Violation("O6", f"no complete run folder: {type(fault).__name__} {fault}")]
    return run, judge(run)


def hides_parts(fault):
    """True for a fault under which no picture shows where parts are now.

    A stamp off by more than a frame is one, and coils that are stuck: they hold the plate off its place, by centimetres.
    """
    return is_blinding(fault) or fault.name in ("camera freeze", "clock skew", *STUCK)


def unnamed_losses(run):
    """O3: a part that leaves the plate ends the run or is named within half a second, unless nothing can be seen then."""
    count = len(run.truth[0][1]) if run.truth else 0
    for part in range(count):
        off_s = None
        for at_s, parts in run.truth + [(run.end_s, run.truth[-1][1])]:
            if parts[part][2]:
                off_s = None
                continue
            off_s = at_s if off_s is None else off_s
            bar_s = run.clear_by(off_s, NAMED_WITHIN_S, hides_parts)
            # a disc that looks like the part is followed in its place until a look at rest shows that it cannot be it
            ghosts_s = [f.from_s for f in run.faults if f.name == "view ghost" and off_s <= f.from_s <= bar_s]
            bar_s = max(bar_s, *(run.clear_by(ghost_s, NAMED_WITHIN_S, hides_parts) for ghost_s in [off_s, *ghosts_s]))
            codes = ("part_lost", "parts_jumped")
            named = any(guard["code"] in codes and off_s <= guard["at_s"] <= bar_s for guard in run.guards)
            if at_s > bar_s and not named:
                yield "O3", f"part {part} is off the plate since {off_s:.3f} s and not named by {bar_s:.3f} s"
                break


def after_the_end(run):
    """O5: no pulse starts after the run's end or after the guard that stopped it."""
    stops = [guard["at_s"] for guard in run.guards if guard["code"] == run.stop_code and guard["code"] not in TOLD_FIRST]
    # completed and stopped runs end where their last guard fired
    last_s = min([run.end_s] + ([max(stops)] if stops else []))
    for pulse in run.pulses:
        if pulse.start_s > last_s + 1e-6:
            yield "O5", f"a pulse starts at {pulse.start_s:.3f} s, after the end at {last_s:.3f} s"


def resources(run):
    """O6: plate time and wall time."""
    limit_s = 3.0 * run.job["limits"]["plate_time_s"] + 20.0
    if run.end_s > run.job["limits"]["plate_time_s"] + OVER_LIMIT_S:
        yield "O6", f"ended at {run.end_s:.1f} s of plate time, {run.job['limits']['plate_time_s']} s asked for"
    if run.report["wall_time_s"] > limit_s:
        yield "O6", f"{run.report['wall_time_s']:.1f} s of wall time, allowed {limit_s:.0f} s"


def false_alarms(run):
    """O8: a run without faults completes and no guard fires."""
    if run.faults:
        return
    if run.outcome != "completed":
        yield "O8", f"{run.outcome} without a fault: {run.report['reason']}"
    for guard in run.guards:
        yield "O8", f"guard {guard['code']} fired at {guard['at_s']:.3f} s without a fault"


def untyped_end(run):
    """O9: once all faults are over a run completes or is stopped with a code."""
    if run.outcome != "completed" and not run.stop_code:
        yield "O9", f"{run.outcome} without a stop code: {run.report['reason']}"
