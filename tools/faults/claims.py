"""O1: a run that claims to be completed has done what the job asked for, in truth, and has looked twice."""
import itertools
import math

from .jobs import RADIUS_MM

SLACK_MM = 0.1
ENDLESS_S = 5.0
# a part that follows a path goes at 8 mm/s and more
LEAST_WAY_MM = 2.0
# looks with table and parts located from nothing that a claim rests on, and how true they are, mm
LOOKS, LOOK_MM = 2, 0.3
# the camera's first frames: what a hold took as its targets
FIRST_FRAMES = 4


def violations(run):
    """Rows of (rule, text, is unobservable)."""
    at = run.final_truth()
    if run.outcome != "completed" or at is None:
        return
    bar_mm = run.tolerance_mm + SLACK_MM
    found = list(errors_of(run, at, bar_mm))
    # without accelerometers a plate that a coil holds off its place looks like a camera that was knocked
    held = [f for f in run.fired() if f.group in ("coil", "coils") and f.kind == "stuck" and f.holds(run.end_s)]
    if held and any(f.group == "accel" for f in run.fired()):
        yield from (("O1", text, True) for text in found)
        return
    yield from unconfirmed(run)
    if found:
        seen = any(not list(errors_of(run, exchanged, bar_mm)) for exchanged in unseen_exchanges(run, at))
        for text in found:
            yield "O1", text, seen
    elif run.report.get("verdict") == "false_success" and not is_held_mirrored(run):
        yield "O1", "the report's verdict is false_success, the true places say that the job is done"


def is_held_mirrored(run):
    """True for a hold in a picture that is mirrored from the beginning on: it asks for no place, and cannot tell."""
    first_s = min((row["at_s"] for row in run.localised), default=0.0)
    mirrors = [fault for fault in run.fired() if fault.name == "camera mirror" and fault.from_s <= first_s]
    return run.job["task"]["type"] == "hold" and any(fault.holds(run.end_s) for fault in mirrors)


def unconfirmed(run):
    """The last things in the journal are looks that show the parts where they truly are, whichever of them."""
    since_s = max((pulse.end_s for pulse in run.pulses), default=0.0)
    is_held = is_held_mirrored(run)
    looks = [row for row in run.confirmed if row["at_s"] >= since_s]
    if len(looks) < LOOKS:
        yield "O1", f"completed after {len(looks)} looks from nothing since the last pulse, {LOOKS} asked for", False
    for row in looks[-LOOKS:]:
        true = run.truth_at(row["at_s"]) or []
        off_mm = max((min(math.dist(seen, part[:2]) for part in true) for seen in row["parts_mm"] if true), default=0.0)
        if off_mm > LOOK_MM and not is_held:
            yield "O1", f"a look at {row['at_s']:.3f} s, before `completed`, is {off_mm:.3f} mm from the truth", False
            return


def errors_of(run, at, bar_mm):
    """What is not as claimed, in words."""
    for part, place in enumerate(at):
        if not place[2]:
            yield f"completed with part {part} off the plate"
    task = run.job["task"]
    rule = {"arrange": of_arrange, "hold": of_hold, "sort": of_sort, "plus_sign": of_plus_sign}.get(task["type"])
    if rule:
        yield from rule(run, task, at, bar_mm)


def of_arrange(run, task, at, bar_mm):
    """Every part at its target; where the job lets parts of one kind exchange targets, each target has one of them."""
    names = task.get("parts") or [row["id"] for row in run.report["parts"]]
    rows, at = zip(*(pair for name in names for pair in zip(run.report["parts"], at) if pair[0]["id"] == name))
    kinds = [row["kind"] for row in rows]
    # places made by a rule (line, circle, text ...) are those that the report assigns; the tests of the rules check them
    asked = task.get("targets_mm") or [row["target_mm"] for row in rows]
    is_fixed = task.get("assignment", "fixed" if "parts" in task else "optimal") == "fixed"

    def fits(part, target):
        allowed = part == target if is_fixed else kinds[part] == kinds[target]
        return allowed and math.dist(at[part][:2], asked[target]) <= bar_mm

    if is_matched(len(at), fits):
        return
    errors_mm = [math.dist(to if is_fixed else row["target_mm"], place[:2]) for to, row, place in zip(asked, rows, at)]
    far = [f"{name} {error_mm:.3f} mm from its target, bar {bar_mm:.2f} mm" for name, error_mm in zip(names, errors_mm) if error_mm > bar_mm]
    yield f"completed with {far[0]}" if far else "completed, and the true places are not the targets of the job"


def is_matched(count, fits):
    """True when every part has a target of its own that fits (augmenting paths)."""
    part_at = {}

    def place(part, tried):
        for target in range(count):
            if target not in tried and fits(part, target):
                tried.add(target)
                if target not in part_at or place(part_at[target], tried):
                    part_at[target] = part
                    return True
        return False

    return all(place(part, set()) for part in range(count))


def of_hold(run, _, at, bar_mm):
    """Every part where it was in one of the first frames."""
    first = [parts for _, parts in run.truth[:FIRST_FRAMES]]
    # the truth begins with the second frame: a part moved by hand before that was elsewhere in the first one
    # (which one of equal parts it was, the reports do not tell)
    moved = [f for f in run.fired() if f.name == "part moved" and first and f.from_s < run.truth[0][0]]
    for fault in moved:
        first.append([[place[axis] - fault.value[axis] for axis in (0, 1)] for place in first[0]])
    for part, place in enumerate(at):
        # a part that was away then is held where it was put back
        back = [parts for _, parts in run.truth if parts[part][2]][:1]
        moved_mm = min((math.dist(parts[part][:2], place[:2]) for parts in first + back), default=0.0)
        if moved_mm > bar_mm:
            yield f"completed with part {part} {moved_mm:.3f} mm from where it was to be held, bar {bar_mm:.2f} mm"


def of_sort(run, task, at, bar_mm):
    """Every part with its rim inside its bin."""
    regions = {name: row["region_mm"] for row in task["bins"] for name in (*row.get("kinds", ()), *row.get("parts", ()))}
    for part, (place, of) in enumerate(zip(at, run.report["parts"])):
        kind, region = of["kind"], regions.get(of["id"], regions.get(of["kind"]))
        if region is None or kind not in RADIUS_MM:
            continue
        inside_mm = min(min(place[i] - region["min"][i], region["max"][i] - place[i]) for i in (0, 1)) - RADIUS_MM[kind]
        if inside_mm < -bar_mm:
            yield f"completed with part {part} {-inside_mm:.3f} mm outside its bin, bar {bar_mm:.2f} mm"


def of_plus_sign(run, task, at, bar_mm):
    """Over the last seconds of an endless job the places it went by are true, and the part gets on."""
    if not run.truth:
        return
    until_s = run.end_s
    if task.get("laps") == 0:
        # after its time limit a run only looks: parts rest until two pictures have come, however slow the camera is
        limit_s = run.job.get("limits", {}).get("plate_time_s", math.inf)
        until_s = min(until_s, max([limit_s, *(cycle.get("ended_at_s", math.inf) for cycle in run.cycles[-1:])]))
    since_s = until_s - ENDLESS_S if task.get("laps") == 0 else 0.0
    recent = [cycle for cycle in run.cycles if cycle["observed_at_s"] >= since_s]
    for cycle in recent:
        true = run.truth_at(cycle["observed_at_s"])
        off_mm = math.dist(cycle["observed_mm"][0], true[0][:2])
        if off_mm > bar_mm:
            yield f"completed, with a path error of {off_mm:.3f} mm at {cycle['observed_at_s']:.3f} s, bar {bar_mm:.2f} mm"
            break
    trail = [parts[0][:2] for at_s, parts in run.truth if since_s <= at_s <= until_s]
    way_mm = max((math.dist(trail[0], place) for place in trail), default=0.0)
    if way_mm < LEAST_WAY_MM:
        yield f"completed, and the part stayed within {way_mm:.2f} mm over the last {until_s - since_s:.1f} s"


def unseen_exchanges(run, at):
    """The true places with as many parts of one kind exchanged back as changed places between two frames.

    Which of them these were is open: faults number parts as the job does, a run numbers equal ones as it sees them.
    """
    kinds = [part["kind"] for part in run.report["parts"]]
    alike = [(a, b) for a, b in itertools.combinations(range(len(kinds)), 2) if kinds[a] == kinds[b]]
    swaps = [fault for fault in run.fired() if fault.name == "parts swapped"]
    swaps = sum(max(fault.value) < len(kinds) and len({kinds[int(v)] for v in fault.value}) == 1 for fault in swaps)
    for count in range(1, swaps + 1):
        for chosen in itertools.product(alike, repeat=count):
            places = list(at)
            for a, b in chosen:
                places[a], places[b] = places[b], places[a]
            yield places
