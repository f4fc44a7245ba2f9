"""O2: after a fault that lies no pulse starts later than its bar; and the bars by which guards have to notice a fault."""
import math
from dataclasses import dataclass

from .actuators import COIL_CODES, LYING_COILS, MOVES_PARTS, misplayed, misread, moved_by_a_lie, tells, was_cut_short
from .vocabulary import FOR_GOOD, is_blinding

FROZEN_S, DARK_S, KNOCKED_S, LATE_PULSES, LATE_FRAMES, KNOCKED_PX = 0.1, 0.2, 0.2, 3, 3, 1.0
# smaller faults are let be: pictures hardly late, a hand at the edge, a stamp that is a few frames off, a weak coil
LEAST = {"camera late": LATE_FRAMES, "view hand": 0.1, "clock skew": 0.15, "gain": 0.15}
LYING_ACCELERATIONS = ("dead", "flip")
# frames in which a knock lies before a run may not complete without noticing it
SEEN_FRAMES = 2
ALIKE_FRAMES = 2
# difference of two equal pulses, as a share of the larger one
ALIKE_SHARE = 0.05
# in which the lightest damped plate swings out to a tenth: 0.08 at 11 Hz
BUMP_SWING_S = 0.4
# segments of a motion without pauses that last as long as a pulse with its rest
SEGMENTS_A_PULSE = 5
# once motors are silent a plate swings out by 2 mm to either side, with the parts, and carries them on a little, mm
COAST_S, UNSEEN_MM = 0.1, 5.0
# an observation this close to the truth is not deceived by a knock, mm
TRUE_MM = 0.25
# pictures lost of which too few are left to time the others; a swing of four standard deviations of a corner's place
MOST_LOST, SEEN_PX = 0.5, 0.2
# share of its force that a stuttering coil leaves out, from which on the plate swings as no plan has it
MOST_STUTTER = 0.2


@dataclass(frozen=True)
class Bar:
    """By when a class of faults is noticed, and by which guards. A count of pulses is one of pulses that tell."""

    codes: tuple
    most_s: float = math.inf
    # where the plate has to be at rest the time counts from the end of the pulse that is being played
    at_rest: bool = False
    pulses: float = math.inf
    cycles: float = math.inf


BARS = {
    "camera freeze": Bar(("camera_frozen", "camera_stale"), FROZEN_S),
    "camera shift": Bar(("camera_moved",), KNOCKED_S, at_rest=True),
    "camera rotate": Bar(("camera_moved",), KNOCKED_S, at_rest=True),
    "camera mirror": Bar(("camera_moved",), KNOCKED_S, at_rest=True),
    "camera late": Bar(("camera_late", "camera_stale"), pulses=LATE_PULSES),
    "coil dead": Bar(COIL_CODES, pulses=1),
    "coil reversed": Bar(COIL_CODES, pulses=1),
    "coil stuck": Bar(COIL_CODES, pulses=1),
    "coil gain": Bar(COIL_CODES, pulses=2),
    "accel dead": Bar(("accelerometer_fault",), pulses=1),
    "accel flip": Bar(("accelerometer_fault",), pulses=1),
    "part glued": Bar(("part_stuck",), cycles=5),
    # before the plate was ever seen nothing tells what hides it
    "camera dark": Bar(("camera_dark", "table_missing"), DARK_S, at_rest=True),
    "view hand": Bar(("view_hidden", "camera_dark", "table_missing"), DARK_S, at_rest=True),
    "clock skew": Bar(("camera_stale",), DARK_S),
    "view ghost": Bar(("foreign_part", "part_count"), 0.5, at_rest=True),
}
BARS |= {f"coils {kind}": BARS["coil dead"] for kind in LYING_COILS} | {"coils gain": BARS["coil gain"]}
# without accelerometers the ways of the parts tell that every coil is reversed
UNWATCHED = Bar(("parts_jumped", *COIL_CODES), pulses=6)


def violations(run):
    for fault in run.fired():
        if fault.name == "camera freeze":
            yield from frozen(run, fault)
            yield from moved_unseen(run, fault)
        elif fault.name in ("camera shift", "camera rotate", "camera mirror"):
            yield from knocked(run, fault)
        elif fault.name == "camera late" and fault.value[0] >= LATE_FRAMES:
            yield from late(run, fault)
        elif fault.group == "accel" and fault.kind in LYING_ACCELERATIONS:
            yield from misread(run, fault)
    yield from misplayed(run)
    yield from played_on(run)
    yield from moved_by_a_lie(run)


def frozen(run, fault):
    bar_s = run.clear_by(fault.from_s, FROZEN_S)
    for pulse in run.pulses:
        if bar_s < pulse.start_s < fault.to_s:
            yield "O2", f"{fault}: a pulse starts at {pulse.start_s:.3f} s, bar {bar_s:.3f} s"
            return


def is_stuck(fault):
    """True for coils that do not obey."""
    return fault.group in ("coil", "coils") and fault.kind == "stuck"


def moved_unseen(run, fault):
    """The motors are silent once the picture is seen to stand still: parts come to rest."""
    begin_s, end_s = run.clear_by(fault.from_s, FROZEN_S) + COAST_S, min(fault.to_s, run.end_s)
    # nothing silences a coil that is stuck at its force
    moves = any(other.group in MOVES_PARTS or is_stuck(other) for other in run.fired())
    if moves or not run.truth or begin_s >= end_s or any(begin_s < pulse.start_s < end_s for pulse in run.pulses):
        return
    before, after = run.truth_at(begin_s), run.truth_at(end_s)
    moved_mm = max(math.dist(a[:2], b[:2]) for a, b in zip(before, after))
    if moved_mm > UNSEEN_MM:
        yield "O2", f"{fault}: a part goes on by {moved_mm:.2f} mm from {begin_s:.3f} s on, bar {UNSEEN_MM:g} mm"


def knocked(run, fault):
    """The table is known as it was seen at the first look: a knock is what differs from that."""
    if not run.localised or moved_px(run, fault) <= KNOCKED_PX:
        return
    first_s = run.localised[0]["at_s"]
    if fault.to_s <= first_s:
        return
    # knocked before the first look, the camera is knocked again at the fault's end
    begin_s, end_s = (fault.to_s, FOR_GOOD) if fault.from_s <= first_s else (fault.from_s, fault.to_s)
    last_s = run.end_s - SEEN_FRAMES * run.frame_s
    is_noticed = any(row["at_s"] > begin_s for row in run.localised) or was_told(run, "camera_moved", begin_s)
    if run.outcome == "completed" and begin_s < last_s < end_s and not is_noticed:
        yield "O2", f"{fault}: completed at {run.end_s:.3f} s, and the knock was not noticed"
    bar_s = run.clear_by(begin_s, KNOCKED_S, hides_knock)
    for pulse in run.pulses:
        if pulse.is_probe or not bar_s < pulse.start_s < end_s or hides_places(run, pulse.seen_at_s):
            continue
        if pulse.seen_at_s <= begin_s or not sees_truly(run, pulse):
            yield "O2", f"{fault}: a pulse starts at {pulse.start_s:.3f} s from a look that is not true, bar {bar_s:.3f} s"
            return


def hides_places(run, at_s):
    """True while late pictures, a coil that holds the plate off its place, or pictures that were mirrored from the first on
    make a look untrue; other rules judge these."""
    first_s = run.localised[0]["at_s"]

    def hides(fault):
        was_mirrored = fault.name == "camera mirror" and fault.from_s <= first_s
        return fault.name == "camera late" or was_mirrored or is_stuck(fault)

    return any(fault.holds(at_s) and hides(fault) for fault in run.faults)


def was_told(run, code, since_s):
    return any(guard["code"] == code and guard["at_s"] >= since_s for guard in run.guards)


def hides_knock(fault):
    return is_blinding(fault) or fault.name == "camera freeze"


def moved_px(run, fault):
    """How far the fault moves the corner of the plate that it moves farthest, px."""
    width, height = run.job["rig"]["camera"]["size_px"]
    middle = (width - 1) / 2, (height - 1) / 2

    def moved(corner):
        x, y = corner[0] - middle[0], corner[1] - middle[1]
        if fault.kind == "shift":
            return math.hypot(*fault.value)
        if fault.kind == "rotate":
            return 2 * math.hypot(x, y) * abs(math.sin(math.radians(fault.value[0]) / 2))
        # mirrored corners change their places
        return min(math.dist((-x, y), (c[0] - middle[0], c[1] - middle[1])) for c in corners)

    corners = run.localised[0]["corners_px"]
    return max(moved(corner) for corner in corners)


def sees_truly(run, pulse):
    """True when the look before a pulse shows every part where there is one, whichever of them.

    In motion it shows a part where it is at some time of the exposure.
    """
    true, before = run.truth_at(pulse.seen_at_s), run.truth_at(pulse.seen_at_s - run.frame_s)
    share = run.job["rig"]["camera"]["exposure_s"] / run.frame_s
    within_mm = [TRUE_MM + share * math.dist(part[:2], was[:2]) for part, was in zip(true or (), before or ())]
    off_mm = lambda seen: min(math.dist(seen, part[:2]) - within for part, within in zip(true, within_mm))
    return bool(true) and all(off_mm(seen) <= 0.0 for seen in pulse.seen_mm)


def late(run, fault):
    # a knock hides how late the pictures before it were: pulses are counted from where the table is located anew
    knocks_s = [other.from_s for other in run.fired() if other.name in ("camera shift", "camera rotate")]
    anew_s = [row["at_s"] for row in run.localised[1:] if any(at_s < row["at_s"] for at_s in knocks_s)]
    since_s = max(anew_s, default=0.0)
    blind = [p for p in run.pulses if p.start_s >= since_s and fault.holds(p.start_s) and not was_cut_short(run, p)]
    blind = [pulse for pulse in blind if not seems_in_time(run, pulse, fault.value[0])]
    blind = [
        pulse for pulse in blind
        if not (was_bumped(run, pulse) or is_hardly_seen(run, pulse) or stutters(run, pulse))
    ]
    most = LATE_PULSES * pulse_segments(run)
    if len(blind) > most:
        yield "O2", f"{fault}: pulse {most + 1} since the fault starts at {blind[most].start_s:.3f} s, bar {most} pulses"


def pulse_segments(run):
    return SEGMENTS_A_PULSE if run.is_moving else 1


def seems_in_time(run, pulse, late_frames):
    """True for a pulse during which pictures so late show the pulse before it, or an equal one two or more before it."""
    earlier = [other for other in run.pulses if other.start_s < pulse.start_s]
    shown = [other for other in earlier if abs((pulse.start_s - other.start_s) / run.frame_s - late_frames) <= ALIKE_FRAMES]
    return any(other is earlier[-1] or is_equal(run, other, pulse) for other in shown)


def is_equal(run, pulse, other):
    """True for two pulses of the same motion and length."""
    if pulse.base_hz != other.base_hz or abs(pulse.end_s - pulse.start_s - other.end_s + other.start_s) > run.frame_s:
        return False
    values, others = ([value for coil in of.counts for value in coil] for of in (pulse, other))
    most = ALIKE_SHARE * max(map(abs, values), default=0.0)
    return len(values) == len(others) and all(abs(a - b) <= most for a, b in zip(values, others))


def stutters(run, pulse):
    """True for a pulse in which a coil stutters strongly, begins or ceases to: pictures in time would not show the planned swing either."""
    chatters = [fault for fault in run.fired() if fault.kind == "chatter"]
    changes = any(pulse.start_s < at_s < pulse.end_s for fault in chatters for at_s in (fault.from_s, fault.to_s))
    strong = (fault for fault in chatters if fault.value[0] >= MOST_STUTTER)
    return changes or any(fault.from_s < pulse.end_s and pulse.start_s < fault.to_s for fault in strong)


def is_hardly_seen(run, pulse):
    """True for a pulse whose pictures do not tell how late they are: they hardly show it, or are lost, or dated wrongly."""
    hides = {"camera drop": lambda share: share > MOST_LOST, "clock skew": lambda _: True}
    hiding = (fault for fault in run.fired() if fault.name in hides and hides[fault.name](fault.value[0]))
    is_hidden = any(fault.from_s < pulse.end_s and pulse.start_s < fault.to_s for fault in hiding)
    return is_hidden or pulse.base_hz == run.job["rig"]["camera"]["frame_hz"] and swing_px(run, pulse) < SEEN_PX


def swing_px(run, pulse):
    """Displacement of a corner in every frame of a pulse of the camera's rate, px; the plate's springs are soft."""
    camera, plate, motors = (run.job["rig"][key] for key in ("camera", "plate", "motors"))
    turn = math.tau * pulse.base_hz * (-pulse.start_s % run.frame_s)

    def place(coil):
        harmonics = enumerate(zip(coil[::2], coil[1::2]), 1)
        return sum((cos * math.cos(k * turn) + sin * math.sin(k * turn)) / k**2 for k, (cos, sin) in harmonics)

    x1, x2, y1, y2 = map(place, pulse.counts)
    lever_m, corner_m = motors["lever_arm_mm"] / 1e3, plate["side_mm"] / 1e3 / math.sqrt(2)
    shift = math.hypot(x1 + x2, y1 + y2) / plate["mass_kg"]
    shift += (abs(x1 - x2) + abs(y1 - y2)) * lever_m * corner_m / plate["inertia_kg_m2"]
    shift_m = shift * motors["newtons_per_count"] / (math.tau * pulse.base_hz) ** 2
    return 1e3 * shift_m * camera["focal_px"] / camera["position_mm"][2]


def was_bumped(run, pulse):
    """True for a pulse in which the plate swings from a bump, farther than most pulses drive it."""
    bumps_s = [fault.from_s for fault in run.fired() if fault.name == "plate bumped"]
    return any(pulse.start_s - BUMP_SWING_S < at_s < pulse.end_s for at_s in bumps_s)


def played_on(run):
    """A pulse in which nothing could be seen ends the sequence that it belongs to."""
    for a, b in zip(run.pulses, run.pulses[1:]):
        if a.cycle == b.cycle and not (a.is_probe or b.is_probe) and was_cut_short(run, a):
            yield "O2", f"the pulse at {b.start_s:.3f} s was planned before the one at {a.start_s:.3f} s was cut short"
            return


@dataclass(frozen=True)
class Notice:
    """When a fault was noticed, against its bar."""

    code: str | None
    text: str
    is_missed: bool


def bar_of(run, fault):
    is_watched = not any(other.group == "accel" and other.from_s <= fault.from_s for other in run.fired())
    return UNWATCHED if fault.name == "coils reversed" and not is_watched else BARS.get(fault.name)


def notice(run, fault):
    """How a run noticed a fault that has a bar; `None` where there is nothing to notice."""
    bar = bar_of(run, fault)
    size = abs(fault.value[0] - (fault.kind == "gain")) if fault.value else math.inf
    if bar is None or fault.from_s >= run.end_s or size < LEAST.get(fault.name if fault.kind != "gain" else "gain", 0.0):
        return None
    found = next((g for g in run.guards if g["code"] in bar.codes and g["at_s"] >= fault.from_s - 1e-6), None)
    by_s = found["at_s"] if found else run.end_s
    after = [pulse for pulse in run.pulses if fault.holds(pulse.start_s) and pulse.start_s < by_s - 1e-4]
    if fault.group in ("coil", "coils", "accel"):
        after = [pulse for pulse in after if tells(run, pulse, fault)]
    cycles = [c for c in run.cycles if c.get("sent") and fault.from_s <= c["observed_at_s"] and c["ended_at_s"] <= by_s + 1e-6]
    begin_s = fault.from_s
    if bar.at_rest:
        begin_s = max([begin_s] + [pulse.end_s for pulse in run.pulses if pulse.start_s <= begin_s < pulse.end_s])
    late_s = max(0.0, min(by_s, fault.to_s) - begin_s)
    many = pulse_segments(run)
    missed = late_s > bar.most_s + run.frame_s or len(after) > many * bar.pulses or len(cycles) > many * bar.cycles
    if bar.most_s < math.inf:
        measure = f"{late_s:.3f} s{' at rest' if bar.at_rest else ''}"
    else:
        measure = f"{len(after)} pulses" if bar.pulses < math.inf else f"{len(cycles)} cycles"
    return Notice(found["code"] if found else None, measure, missed)
