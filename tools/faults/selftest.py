"""Tests of the oracle: run folders made by hand, for each rule some that break it and some that do not."""
import json
import pathlib
import random
import tempfile
import unittest

from . import detection, jobs, oracle, schedules
from .vocabulary import Fault

CYCLE_S, FRAME_S = 0.5, 1 / 60
TARGETS = [[50.0, 0.0], [-50.0, 0.0]]
STRONG = [[[300.0, 0.0]], [[200.0, 0.0]], [[250.0, 0.0]], [[250.0, 0.0]]]
TIMES = {"attack_s": 0.066667, "sustain_s": 0.3, "rest_s": 0.04, "base_hz": 30.0}
CORNERS = [[230.0, 63.0], [1106.0, 85.0], [1085.0, 964.0], [205.0, 940.0]]
# a fault that changes nothing, but has a run's truth written
LIGHT = "light:gain=0.9@0"


# where a part truly is: (folder, part, time) to (x, y, on the plate)


def straight(folder, part, at_s):
    """To its target, where it is at the end."""
    return TARGETS[part][0], 40.0 * max(0.0, 1.0 - at_s / folder.end_s), 1


def beside(folder, part, at_s):
    return TARGETS[part][0], 40.0 * max(0.02, 1.0 - at_s / folder.end_s), 1


def exchanged_from(since_s):
    return lambda folder, part, at_s: straight(folder, 1 - part if at_s >= since_s else part, at_s)


def there(_, part, __):
    return *TARGETS[part], 1


def still(_, __, ___):
    return 0.0, 40.0, 1


def falls(_, part, at_s):
    return 0.0, 40 - 10 * at_s, 0 if part == 0 and at_s > 1.5 else 1


def along(y_of):
    """Both parts at one place after the other: they move as one."""
    return lambda _, __, at_s: (0.0, y_of(at_s), 1)


def apart(y_of, x_mm=10.0, gap_mm=50.0):
    return lambda _, part, at_s: (x_mm + gap_mm * part, y_of(at_s), 1)


class Folder:
    """A run of two equal pennies, each on its way to a target; `cycles` cycles of half a second with a pulse each.

    `task` changes the job's, `told` are the targets in the report, `stop` is the guard that ends the run, with its time.
    """

    def __init__(self, faults="", cycles=6, true=straight, seen=None, counts=STRONG, task=None, told=TARGETS, outcome="completed",
                 end_s=None, looks=2, extra=(), guards=(), stop=None):
        self.job = jobs.make(random.Random(0), "equal", "upm-2", "synthesized_field", is_small=False).job
        self.job["task"] |= {"targets_mm": TARGETS} | (task or {})
        self.job["faults"] = [Fault.parse(text).row() for text in faults.split(",") if text]
        self.cycles, self.true, self.counts, self.told, self.looks, self.extra = cycles, true, counts, told, looks, extra
        self.end_s = end_s or (stop[1] if stop else 0.03 + cycles * CYCLE_S)
        self.seen = seen or (lambda part, at_s: self.at(at_s)[part][:2])
        guards = [{"code": code, "at_s": at_s, "text": code} for code, at_s in [*guards, *([stop] if stop else [])]]
        self.report = {"outcome": outcome, "reason": "every part is at its place", "guards": guards, "wall_time_s": 1.0}
        if stop:
            self.report |= {"outcome": "failed", "stop": {"code": stop[0], "text": stop[0]}}

    def at(self, at_s):
        return [self.true(self, part, at_s) for part in (0, 1)]

    def lines(self):
        yield {"type": "localised", "at_s": 0.016667, "corners_px": CORNERS, "parts": []}
        for cycle in range(self.cycles):
            at_s = 0.033333 + cycle * CYCLE_S
            if at_s + 0.001 >= self.end_s:
                break
            seen, after = ([list(self.seen(part, t)) for part in (0, 1)] for t in (at_s, at_s + CYCLE_S))
            wanted = {"subgoals_mm": TARGETS, "targets_mm": TARGETS, "cross_track_mm": [0.0, 0.0]}
            yield {
                "type": "cycle", "cycle": cycle, "observed_at_s": at_s, "observed_mm": seen, "wanted": wanted,
                "sent": [pulse_row(at_s + 0.001, self.counts)], "ended_at_s": at_s + CYCLE_S, "result_mm": after,
            }  # fmt: skip
        for number in range(self.looks):
            at_s = self.end_s - number * FRAME_S
            yield {"type": "confirmed", "at_s": at_s, "parts_mm": [list(part[:2]) for part in self.at(at_s)]}
        yield from self.extra

    def write(self, folder):
        write = lambda name, *rows: (pathlib.Path(folder) / name).write_text("".join(json.dumps(row) + "\n" for row in rows))
        write("effective.json", {"job": self.job, "version": "0"})
        write("journal.jsonl", *self.lines())
        if self.job["faults"]:
            frames = [i * FRAME_S for i in range(1, int(self.end_s / FRAME_S) + 1)]
            write("truth.jsonl", *({"at_s": at_s, "parts": self.at(at_s)} for at_s in frames))
        ends = zip(self.told, self.at(self.end_s))
        parts = [{"id": f"penny-{i}", "kind": "penny", "target_mm": to, "true_mm": at[:2]} for i, (to, at) in enumerate(ends)]
        write("report.json", {"plate_time_s": self.end_s, "parts": parts} | self.report)

    def judged(self):
        with tempfile.TemporaryDirectory() as folder:
            self.write(folder)
            return oracle.judge_folder(folder)

    def rules(self):
        """Rules that the run breaks; in brackets where no picture shows it."""
        return sorted({f"({v.rule})" if v.is_unobservable else v.rule for v in self.judged()[1]})


def pulse_row(start_s, counts=STRONG):
    return {"started_at_s": start_s, "counts": counts} | TIMES


def bins(limit_mm):
    return {"type": "sort", "bins": [{"kinds": ["penny"], "region_mm": {"min": [-limit_mm - 5, -30], "max": [limit_mm, 30]}}]}


BESIDE_ONE = [[50.0, 1.0], [-50.0, 0.0]]
HELD = {"cycles": 0, "end_s": 5.0, "guards": [("camera_moved", 0.6)],
        "task": {"type": "hold", "duration_s": 5, "targets_mm": [[0, 0], [50, 0]]}}  # fmt: skip
ENDLESS = {"cycles": 20, "task": {"type": "plus_sign", "laps": 0}}
BY_LINE = {"targets_mm": None, "targets": {"line": {"from_mm": [-50, 0], "to_mm": [50, 0]}}}
OFF_LOOK = [{"type": "confirmed", "at_s": 3.02, "parts_mm": [[0.0, 0.0], [-50.0, 0.0]]}]
AFTER_END = [{"type": "unfinished_cycle", "cycle": 9, "sent": [pulse_row(2.1)]}]
SLOW_LIE = {"stop": ("coil_fault", 0.5)}
# all coils send as much to x as to y, so that an exchange of two axes is seen
SWAPS = [[[500.0, 0.0]], [[200.0, 0.0]], [[-250.0, 0.0]], [[250.0, 0.0]]]
# centre and spin cancel where the first accelerometer is, along y
CANCEL = [[[-16.0, 0.0]], [[-16.0, 0.0]], [[300.0, 0.0]], [[0.0, 0.0]]]
LOST = {"true": falls, "seen": lambda _, at_s: (0.0, 40 - 10 * at_s), "outcome": "failed"}
OFF = "part0:moved=200;0@1.5"


def knocked(part, at_s):
    return TARGETS[part][0] + (1.0 if at_s > 0.7 else 0.0), 40.0 * max(0.0, 1.0 - at_s / 3.03)


# what a case is about: the rules it breaks, the run
CASES = [
    ("done", [], Folder(LIGHT)),
    ("a part is beside its target", ["O1"], Folder(LIGHT, true=beside)),
    ("and the run does not claim to be completed", [], Folder(LIGHT, true=beside, outcome="failed")),
    ("targets are not the job's", ["O1"], Folder(LIGHT, task={"targets_mm": BESIDE_ONE})),
    ("nor any assignment of them", ["O1"], Folder(LIGHT, task={"targets_mm": BESIDE_ONE, "assignment": "optimal"})),
    ("places made by a rule are those of the report", [], Folder(LIGHT, task=BY_LINE)),
    ("and are to be reached", ["O1"], Folder(LIGHT, task=BY_LINE, told=BESIDE_ONE)),
    ("one part by name", [], Folder(LIGHT, true=exchanged_from(0), task={"parts": ["penny-1"], "targets_mm": TARGETS[:1]})),
    ("not at its target", ["O1"], Folder(LIGHT, task={"parts": ["penny-1"], "targets_mm": TARGETS[:1]})),
    ("parts exchange fixed targets", ["O1"], Folder(LIGHT, true=exchanged_from(0))),
    ("parts of a kind exchange targets that are free", [], Folder(LIGHT, true=exchanged_from(0), task={"assignment": "optimal"})),
    ("equal parts exchanged between frames", ["(O1)"], Folder("parts:swapped=0;1@1", true=exchanged_from(1))),
    ("the exchange is not that of the fault", ["O1"], Folder("parts:swapped=0;1@9", true=exchanged_from(1))),
    ("a claim on one look", ["O1"], Folder(looks=1)),
    ("a look that is not where the parts are", ["O1"], Folder(LIGHT, extra=OFF_LOOK)),
    ("held", [], Folder("camera:shift=9;0@0.5", true=apart(lambda _: 0.0, gap_mm=40.0), **HELD)),
    ("not held", ["O1"], Folder("camera:shift=9;0@0.5", true=lambda _, part, at_s: (10 + 40 * part + at_s, 0.0, 1), **HELD)),
    ("outside of the bin", ["O1"], Folder(LIGHT, task=bins(45.0))),
    ("within it", [], Folder(LIGHT, task=bins(60.0))),
    ("an endless job gets on", [], Folder(LIGHT, true=along(lambda at_s: 5.0 * at_s), **ENDLESS)),
    ("and sees wrongly", ["O1"], Folder(LIGHT, true=along(lambda at_s: 5 * at_s), seen=lambda _, at_s: (1.0, 5 * at_s), **ENDLESS)),
    ("pulses after a freeze", ["O2"], Folder("camera:freeze@0.7")),
    ("a freeze that stops the run", [], Folder("camera:freeze@0.7", stop=("camera_frozen", 0.79))),
    ("a freeze over before the next pulse", [], Folder("camera:freeze@0.7-1", true=there)),
    ("dark, too: nothing to see", [], Folder("camera:freeze@0.7,camera:dark@0.7-5")),
    ("a knock", ["O2"], Folder("camera:shift=3;0@0.7", seen=knocked)),
    ("a knock after which it sees truly", [], Folder("camera:shift=3;0@0.7", guards=[("camera_moved", 0.9)])),
    ("a knock shortly before the end", ["O2"], Folder("camera:shift=3;0@2.95")),
    ("a knock too late for two frames", [], Folder("camera:shift=3;0@3.01")),
    ("a knock over before the first look", [], Folder("camera:shift=3;0@0-0.016667")),
    ("a knock over after the first look", ["O2"], Folder("camera:shift=3;0@0-0.02")),
    ("a small knock", [], Folder("camera:shift=0.5;0.5@0.7")),
    ("back where it was, from the end of the fault on", ["O2"], Folder("camera:shift=3;0@0-0.7", seen=knocked)),
    ("knocked before the table was located", [], Folder("camera:shift=3;0@0", seen=knocked)),
    ("turned", ["O2"], Folder("camera:rotate=1@0.7", seen=knocked)),
    ("mirrored", ["O2"], Folder("camera:mirror@0.7", seen=knocked)),
    ("late pictures", ["O2"], Folder("camera:late=4@0")),
    ("hardly late ones", [], Folder("camera:late=2@0")),
    ("late ones after a while", ["O2"], Folder("camera:late=4@0.9")),
    ("on a plate that was pushed", [], Folder("camera:late=4@0.9,plate:bumped=2;1@1.4")),
    ("late ones that stop the run", [], Folder("camera:late=4@0", stop=("camera_late", 1.1))),
    *((f"{lie} lies", ["O2"], Folder(f"{lie}@0", true=there, counts=SWAPS)) for lie in
      ("coil0:dead", "coil2:reversed", "coils:swapped=0;2", "coils:dead", "coil1:stuck")),
    *((f"{lie} stops the run", [], Folder(f"{lie}@0", true=there, counts=SWAPS, **SLOW_LIE)) for lie in
      ("coil0:dead", "coil2:reversed", "coils:swapped=0;2", "coils:dead", "coil1:stuck")),
    ("nothing is sent to that coil", [], Folder("coil0:dead@0", counts=[[[0.0, 0.0]], *STRONG[1:]])),
    ("a pulse too weak to tell", [], Folder("coil0:dead@0", counts=[[[4.0, 0.0]]] * 4)),
    ("both coils play the same", [], Folder("coils:swapped=2;3@0")),
    ("a run that goes on unwatched", [], Folder("coil0:dead@0,accel0:gain=0.9@0")),
    ("parts go on while the picture stands still", ["O2"],
     Folder("camera:freeze@0.1", 1, apart(lambda at_s: 8.0 * at_s), stop=("camera_frozen", 1.5))),
    ("parts rest", [], Folder("camera:freeze@0.1", 1, apart(lambda at_s: min(at_s, 0.3)), stop=("camera_frozen", 1.5))),
    ("a coil that lies moves a part", ["O2"], Folder("coil0:dead@0", true=apart(lambda at_s: 1.2 * (at_s > 0.1)), **SLOW_LIE)),
    ("by less than the bar", [], Folder("coil0:dead@0", true=apart(lambda at_s: 0.8 * (at_s > 0.1)), **SLOW_LIE)),
    ("from the first pulse on", [], Folder("coil0:dead@0.3", true=apart(lambda at_s: 1.2 * (at_s > 0.1)), **SLOW_LIE)),
    ("an accelerometer lies", ["O2"], Folder("accel0:flip@0")),
    ("and is named", [], Folder("accel0:flip@0", guards=[("accelerometer_fault", 0.51)])),
    ("and is named late", ["O2"], Folder("accel0:flip@0", guards=[("accelerometer_fault", 1.2)])),
    ("an accelerometer that clips", [], Folder("accel0:clipped=5@0")),
    ("an accelerometer that would show nothing", [], Folder("accel1:flip@0", counts=CANCEL)),
    ("a part off the plate", ["O3"], Folder(OFF, **LOST)),
    ("is named", [], Folder(OFF, guards=[("part_lost", 1.9)], **LOST)),
    ("ends the run", [], Folder(OFF, stop=("part_lost", 1.9), **LOST)),
    ("is not to be seen", [], Folder(f"{OFF},camera:dark@1.4", **LOST)),
    ("cycles without true progress", ["O4"], Folder("coils:gain=0.01@0", 40, still, outcome="failed")),
    ("few of them", [], Folder("coils:gain=0.01@0", 20, still, outcome="failed", end_s=10.0)),
    ("slow progress", [],
     Folder("coils:gain=0.01@0", 40, along(lambda at_s: 40.0 * 0.95 ** (at_s / CYCLE_S)), outcome="failed", end_s=20.0)),
    ("no pulse after the end", [], Folder(LIGHT, stop=("camera_frozen", 2.0))),
    ("a pulse after the end", ["O5"], Folder(LIGHT, stop=("camera_frozen", 2.0), extra=AFTER_END)),
    ("no fault", [], Folder()),
    ("a guard without a fault", ["O8"], Folder(guards=[("part_stuck", 1.0)])),
    ("a failure without a fault", ["O8"], Folder(outcome="failed")),
    ("faults are over, and no code", ["O9"], Folder("light:gain=0.9@0-2", outcome="failed")),
    ("faults are over, and a code", [], Folder("light:gain=0.9@0-2", stop=("time_limit", 3.0))),
]

# run, code of the guard that noticed its first fault, the words for it, whether the bar is missed; `...` is any
NOTICES = [
    (Folder("camera:freeze@0.7", stop=("camera_frozen", 0.78)), "camera_frozen", "0.080 s", False),
    (Folder("camera:freeze@0.7"), None, ..., True),
    (Folder("coil0:dead@0", stop=("coil_fault", 1.1)), "coil_fault", ..., True),
    (Folder("coil0:gain=0.85@0", guards=[("coil_fault", 1.02)]), "coil_fault", ..., False),
    (Folder("coils:reversed@0.01,accel0:dead@0", stop=("parts_jumped", 2.5)), "parts_jumped", ..., False),
    (Folder("coils:reversed@0.01,accel0:dead@0", cycles=9, stop=("part_lost", 4.4)), None, ..., True),
    # from the end of the pulse on
    (Folder("camera:shift=3;0@0.6", stop=("camera_moved", 1.15)), "camera_moved", "0.142 s at rest", False),
]


class Rules(unittest.TestCase):
    def test_cases(self):
        for what, rules, folder in CASES:
            with self.subTest(what):
                self.assertEqual(folder.rules(), rules)

    def test_endless_job_that_stands_is_no_success(self):
        self.assertIn("O1", Folder(LIGHT, true=along(lambda at_s: 5.0 * min(at_s, 4.0)), **ENDLESS).rules())

    def test_plate_that_is_held_shows_no_accelerometers(self):
        held = Folder("accel0:flip@0,coils:stuck@0.05").judged()[1]
        self.assertFalse(any("accel0" in violation.text for violation in held))

    def test_missing_folder_is_a_violation(self):
        with tempfile.TemporaryDirectory() as folder:
            run, found = oracle.judge_folder(folder)
        self.assertEqual((run, [violation.rule for violation in found]), (None, ["O6"]))

    def test_notice_measures_against_the_bar(self):
        for folder, *expected in NOTICES:
            run, _ = folder.judged()
            notice = detection.notice(run, run.faults[0])
            found = (notice.code, notice.text, notice.is_missed)
            for one, other in zip(found, expected):
                self.assertTrue(other is ... or one == other, (folder.job["faults"], found, expected))
        run, _ = Folder("light:gain=0.5@0").judged()
        self.assertIsNone(detection.notice(run, run.faults[0]))


class Words(unittest.TestCase):
    def test_named_schedules_are_read_and_told_alike(self):
        named = [Fault.parse(text) for text in schedules.SCHEDULES.values()]
        self.assertEqual(len(set(map(str, named))), 55)
        for fault in named:
            self.assertEqual((Fault.parse(str(fault)), Fault.of(fault.row())), (fault, fault))
