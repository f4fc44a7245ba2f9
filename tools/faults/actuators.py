"""O2 for coils and accelerometers: what a pulse should have shown of those that lie, and what was done after it."""
import math

LYING_COILS = ("dead", "reversed", "swapped", "stuck")
# a pulse that is played wrongly tells so from this part of its force on, and only a strong one
TELLING_SHARE, TELLING_DRIVE = 0.25, 0.05
# by so much the probe moves parts at most when a coil lies, mm
PROBE_MM = 1.0
# faults that move parts or let them slip
MOVES_PARTS = ("part", "parts", "plate")
BLIND_CODES = ("camera_frozen", "camera_stale", "camera_dark", "view_hidden")
COIL_CODES = ("coil_fault", "motion_off")


def was_cut_short(run, pulse):
    """True for a pulse in which nothing, or not every part, could be seen, and which was ended for it."""
    return any(guard["code"] in BLIND_CODES and pulse.start_s < guard["at_s"] < pulse.end_s for guard in run.guards)


def is_strong(run, pulse):
    """True for a pulse of which the accelerometers can tell anything."""
    if was_cut_short(run, pulse):
        return False
    drive = math.sqrt(sum(value * value for coil in pulse.counts for value in coil))
    long_enough = pulse.sustain_s >= 1.0 / pulse.base_hz
    return long_enough and drive >= TELLING_DRIVE * run.job["rig"]["motors"]["count_limit"]


def coil_faults(run, pulse):
    """Faults of coils that hold through a pulse."""
    coils = (fault for fault in run.faults if fault.group in ("coil", "coils"))
    return [fault for fault in coils if fault.from_s <= pulse.start_s and pulse.end_s <= fault.to_s]


def played_wrongly(run, pulse):
    """The force that is not as it was sent, as a part of that."""
    gain, source = [1.0] * 4, [0, 1, 2, 3]
    for fault in coil_faults(run, pulse):
        if fault.kind == "swapped":
            a, b = (int(v) for v in fault.value)
            source[a], source[b] = source[b], source[a]
            continue
        by = {"dead": 0.0, "stuck": 0.0, "reversed": -1.0}.get(fault.kind, 1.0)
        if fault.kind == "gain":
            by = fault.value[0]
        elif fault.kind == "low_pass":
            by = 1.0 / math.hypot(1.0, pulse.base_hz / fault.value[0])
        for coil in range(4) if fault.group == fault.component else (int(fault.component[-1]),):
            gain[coil] *= by
    pairs = ((sent, gain[i] * played) for i in range(4) for sent, played in zip(pulse.counts[i], pulse.counts[source[i]]))
    off, sent = map(sum, zip(*(((played - sent) ** 2, sent**2) for sent, played in pairs)))
    return math.sqrt(off / sent) if sent else 0.0


def misplayed(run):
    """Coils that lie: one pulse may tell, the next one must not start; of motions without pauses it has, and may tell, too."""
    if any(fault.group == "accel" for fault in run.fired()):
        # a run whose accelerometers are faulty goes on unwatched
        return
    told = []
    for pulse in run.pulses:
        lying = [fault for fault in coil_faults(run, pulse) if fault.kind in LYING_COILS]
        if len(told) > run.is_moving and lying and not pulse.is_probe:
            yield "O2", f"{lying[0]}: a pulse starts at {pulse.start_s:.3f} s, after the one at {told[-1].start_s:.3f} s that tells"
            return
        telling = lying and is_strong(run, pulse) and played_wrongly(run, pulse) >= TELLING_SHARE
        told += [pulse] * bool(telling)


def moved_by_a_lie(run):
    """A coil that lies from before the first pulse on moves no part in a run that ends by it: the small pulse tells."""
    first_s = run.pulses[0].start_s if run.pulses else 0.0
    lies = [fault for fault in coil_faults(run, run.pulses[0]) if fault.kind in LYING_COILS] if run.pulses else []
    # coils that change within the pulse are a jolt
    inside = [at_s for f in run.fired() if f.group in ("coil", "coils") for at_s in (f.from_s, f.to_s)]
    jolts = any(run.pulses[0].start_s < at_s < run.pulses[0].end_s for at_s in inside) if run.pulses else False
    jolts = jolts or any(f.group in ("coil", "coils") and f.kind == "chatter" for f in run.fired())
    others = jolts or any(f.group in ("accel", *MOVES_PARTS) for f in run.fired())
    if not lies or others or run.stop_code not in COIL_CODES or not run.truth:
        return
    before, after = run.truth_at(first_s), run.truth[-1][1]
    moved_mm = max(math.dist(a[:2], b[:2]) for a, b in zip(before, after))
    # without pauses the first segment tells: friction pulls a part no farther in it
    pull_mps2 = 9.81 * run.job["rig"]["friction"]["coefficient"]
    bar_mm = 500 * pull_mps2 * run.pulses[0].attack_s ** 2 if run.is_moving else PROBE_MM
    if moved_mm > bar_mm:
        yield "O2", f"{lies[0]}: a part is moved by {moved_mm:.2f} mm before it is noticed, bar {bar_mm:.1f} mm"


def misread(run, fault):
    """Accelerometers that lie: the guard fires before the second pulse; of motions without pauses the second has begun."""
    pulse = next((pulse for pulse in run.pulses if tells(run, pulse, fault)), None)
    if pulse is None or pulse.end_s > run.end_s:
        return
    later = [other.start_s for other in run.pulses if other.start_s > pulse.start_s]
    bar_s = min(later[run.is_moving :], default=run.end_s)
    codes = ("accelerometer_fault", *(COIL_CODES if any(f.group in ("coil", "coils") for f in run.fired()) else ()))
    named = any(guard["code"] in codes and guard["at_s"] <= bar_s + 1e-4 for guard in run.guards)
    if not named and not (run.stop_code and not later):
        yield "O2", f"{fault}: not named by {bar_s:.3f} s, after the pulse at {pulse.start_s:.3f} s"


def tells(run, pulse, fault):
    """True for a pulse, all of it under the fault, that shows a fault of a coil or an accelerometer if any does."""
    if not (fault.from_s <= pulse.start_s and pulse.end_s <= fault.to_s and is_strong(run, pulse)):
        return False
    if fault.kind == "swapped":
        return played_wrongly(run, pulse) >= TELLING_SHARE
    if fault.group == "coils":
        return True
    if fault.group == "accel" and moves_nothing(run, pulse):
        return False
    number = int(fault.component[-1])
    share = channel_share(run, pulse, number) if fault.group == "accel" else drive_share(pulse, number)
    return share >= TELLING_SHARE


def moves_nothing(run, pulse):
    """True for a pulse within which no coil moves the plate: no accelerometer shows anything then."""
    still = (fault for fault in run.fired() if fault.name in ("coils stuck", "coils dead"))
    return any(fault.from_s < pulse.end_s and pulse.start_s < fault.to_s for fault in still)


def drive_share(pulse, coil):
    """Part of a pulse's drive on this coil."""
    squares = [sum(value * value for value in values) for values in pulse.counts]
    return math.sqrt(squares[coil] / sum(squares)) if sum(squares) else 0.0


def channel_share(run, pulse, channel):
    """Part of a pulse's acceleration that the accelerometer channel x1, y1, x2 or y2 should show, of all four.

    A free plate under the coils' forces: centre and spin may cancel where an accelerometer is, whatever the coils play.
    """
    rig = run.job["rig"]
    arm_m, side_m = rig["motors"]["lever_arm_mm"] * 1e-3, rig["plate"]["side_mm"] * 1e-3
    x_m, y_m = (mm * 1e-3 for mm in rig["accelerometers"]["position_mm"])
    gyration_m2 = side_m**2 / 6
    squares = [0.0] * 4
    for x1, x2, y1, y2 in zip(*pulse.counts):
        force_x, force_y, spin = x1 - x2, y1 - y2, arm_m * (y1 + y2 - x1 - x2) / gyration_m2
        shown = force_x - spin * y_m, force_y + spin * x_m, force_x + spin * y_m, force_y - spin * x_m
        squares = [square + value * value for square, value in zip(squares, shown)]
    return math.sqrt(squares[channel] / sum(squares)) if sum(squares) else 0.0
