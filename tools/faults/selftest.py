"""Tests of the oracle and the shrinker: run folders made by hand, for each rule one that breaks it and one that does not."""
import json
import pathlib
import random
import tempfile
import unittest

from . import campaign, detection, jobs, oracle, schedules, shrink, tables, vocabulary
from .runs import Process
from .vocabulary import Fault

CYCLE_S, FRAME_S = 0.5, 1 / 60
STRONG = [[[300.0, 0.0]], [[200.0, 0.0]], [[250.0, 0.0]], [[250.0, 0.0]]]


class Folder:
    """A run of two equal pennies, each on its way to a target; `cycles` cycles of half a second with a pulse each."""

    def __init__(self, faults="", cycles=6):
        made = jobs.make(random.Random(0), "equal", "upm-2", "synthesized_field", is_small=False)
        self.job = made.job
        self.job["task"]["targets_mm"] = [[50.0, 0.0], [-50.0, 0.0]]
        self.job["faults"] = [Fault.parse(text).row() for text in faults.split(",") if text]
        self.cycles, self.end_s = cycles, 0.03 + cycles * CYCLE_S
        self.true = lambda part, at_s: (self.target(part)[0], 40.0 * max(0.0, 1.0 - at_s / self.end_s), 1)
        self.seen = lambda part, at_s: self.true(part, at_s)[:2]
        self.counts = lambda cycle: STRONG
        self.report = {"outcome": "completed", "reason": "every part is at its place", "guards": [], "wall_time_s": 1.0}
        self.extra = []
        # looks from nothing before the end
        self.looks = 2

    def target(self, part):
        return self.job["task"]["targets_mm"][part]

    def guard(self, code, at_s, stops=False):
        self.report["guards"].append({"code": code, "at_s": at_s, "text": code})
        if stops:
            self.end_s = at_s
            self.report |= {"outcome": "failed", "stop": {"code": code, "text": code}}
        return self

    def lines(self):
        corners = [[230.0, 63.0], [1106.0, 85.0], [1085.0, 964.0], [205.0, 940.0]]
        yield {"type": "localised", "at_s": 0.016667, "corners_px": corners, "parts": []}
        for cycle in range(self.cycles):
            at_s = 0.033333 + cycle * CYCLE_S
            if at_s + 0.001 >= self.end_s:
                break
            seen, after = ([list(self.seen(part, t)) for part in (0, 1)] for t in (at_s, at_s + CYCLE_S))
            targets = [list(self.target(part)) for part in (0, 1)]
            wanted = {"subgoals_mm": targets, "targets_mm": targets, "cross_track_mm": [0.0, 0.0]}
            yield {
                "type": "cycle", "cycle": cycle, "observed_at_s": at_s, "observed_mm": seen, "wanted": wanted,
                "sent": [pulse_row(at_s + 0.001, self.counts(cycle))], "ended_at_s": at_s + CYCLE_S, "result_mm": after,
            }  # fmt: skip
        for number in range(self.looks):
            at_s = self.end_s - number * FRAME_S
            yield {"type": "confirmed", "at_s": at_s, "parts_mm": [list(self.true(part, at_s)[:2]) for part in (0, 1)]}
        yield from self.extra

    def write(self, folder):
        folder = pathlib.Path(folder)
        (folder / "effective.json").write_text(json.dumps({"job": self.job, "version": "0"}))
        (folder / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in self.lines()))
        if self.job["faults"]:
            frames = [i * FRAME_S for i in range(1, int(self.end_s / FRAME_S) + 1)]
            truth = [{"at_s": at_s, "parts": [self.true(part, at_s) for part in (0, 1)]} for at_s in frames]
            (folder / "truth.jsonl").write_text("".join(json.dumps(row) + "\n" for row in truth))
        parts = [
            {"id": f"penny-{part + 1}", "kind": "penny", "target_mm": self.target(part), "true_mm": self.true(part, self.end_s)[:2]}
            for part in (0, 1)
        ]
        (folder / "report.json").write_text(json.dumps({"plate_time_s": self.end_s, "parts": parts} | self.report))

    def judged(self, process=None, is_liveness=None):
        with tempfile.TemporaryDirectory() as folder:
            self.write(folder)
            return oracle.judge_folder(folder, process, is_liveness)

    def rules(self, *args, **kwargs):
        """Rules that the run breaks; in brackets where no picture shows it."""
        found = self.judged(*args, **kwargs)[1]
        return sorted({f"({v.rule})" if v.is_unobservable else v.rule for v in found})


def pulse_row(start_s, counts=STRONG):
    times = {"attack_s": 0.066667, "sustain_s": 0.3, "rest_s": 0.04, "base_hz": 30.0}
    return {"started_at_s": start_s, "counts": counts} | times


def fine_process(**changes):
    return Process(**({"status": 0, "wall_s": 1.0, "rss_mb": 50.0, "stderr": "", "allowed_s": 50.0} | changes))


class Claims(unittest.TestCase):
    def test_completed_with_a_part_beside_its_target_is_a_false_success(self):
        self.assertEqual(Folder("light:gain=0.9@0").rules(), [])
        folder = Folder("light:gain=0.9@0")
        folder.true = lambda part, at_s: (folder.target(part)[0], 40.0 * max(0.02, 1.0 - at_s / folder.end_s), 1)
        self.assertEqual(folder.rules(), ["O1"])
        folder.report["outcome"] = "failed"
        self.assertEqual(folder.rules(), [])

    def test_targets_that_are_not_the_jobs_are_a_false_success(self):
        run, _ = Folder("light:gain=0.9@0").judged()
        run.job["task"]["targets_mm"] = [[50.0, 1.0], [-50.0, 0.0]]
        self.assertEqual({violation.rule for violation in oracle.judge(run)}, {"O1"})
        run.job["task"]["assignment"] = "optimal"
        self.assertEqual({violation.rule for violation in oracle.judge(run)}, {"O1"})

    def test_places_made_by_a_rule_are_judged_by_those_that_the_report_assigns(self):
        run, _ = Folder("light:gain=0.9@0").judged()
        task = run.job["task"]
        del task["targets_mm"]
        task["targets"] = {"line": {"from_mm": [-50, 0], "to_mm": [50, 0]}}
        self.assertEqual([violation.rule for violation in oracle.judge(run)], [])
        run.report["parts"][0]["target_mm"] = [50.0, 1.0]
        self.assertEqual({violation.rule for violation in oracle.judge(run)}, {"O1"})

    def test_parts_of_a_kind_may_exchange_targets_where_the_job_says_so(self):
        folder = Folder("light:gain=0.9@0")
        straight = folder.true
        folder.true = lambda part, at_s: straight(1 - part, at_s)
        self.assertEqual(folder.rules(), ["O1"])
        folder.job["task"]["assignment"] = "optimal"
        self.assertEqual(folder.rules(), [])

    def test_equal_parts_exchanged_between_frames_are_counted_apart(self):
        folder = Folder("parts:swapped=0;1@1")
        straight = folder.true
        folder.true = lambda part, at_s: straight(1 - part if at_s >= 1 else part, at_s)
        self.assertEqual(folder.rules(), ["(O1)"])
        folder.job["faults"] = [Fault.parse("parts:swapped=0;1@9").row()]
        self.assertEqual(folder.rules(), ["O1"], "the exchange is not that of the fault")

    def test_claim_rests_on_two_looks(self):
        folder = Folder()
        folder.looks = 1
        self.assertEqual(folder.rules(), ["O1"])
        folder = Folder("light:gain=0.9@0")
        folder.extra = [{"type": "confirmed", "at_s": 3.02, "parts_mm": [[0.0, 0.0], [-50.0, 0.0]]}]
        self.assertEqual(folder.rules(), ["O1"], "not where the parts are")

    def test_hold_is_judged_by_where_parts_were_at_first(self):
        folder = Folder("camera:shift=9;0@0.5", cycles=0).guard("camera_moved", 0.6)
        folder.end_s, folder.job["task"] = 5.0, {"type": "hold", "duration_s": 5, "targets_mm": [[0, 0], [50, 0]]}
        folder.true = lambda part, at_s: (10.0 + part * 40.0, 0.0, 1)
        self.assertEqual(folder.rules(), [])
        folder.true = lambda part, at_s: (10.0 + part * 40.0 + at_s, 0.0, 1)
        self.assertEqual(folder.rules(), ["O1"])

    def test_sorted_part_outside_its_bin_is_a_false_success(self):
        for limit, rules in ((45.0, ["O1"]), (60.0, [])):
            folder = Folder("light:gain=0.9@0")
            region = {"min": [-limit - 5, -30], "max": [limit, 30]}
            folder.job["task"] |= {"type": "sort", "bins": [{"kinds": ["penny"], "region_mm": region}]}
            self.assertEqual(folder.rules(), rules)

    def test_endless_job_has_to_get_on_and_to_see_truly(self):
        def endless():
            folder = Folder("light:gain=0.9@0", cycles=20)
            folder.job["task"] |= {"type": "plus_sign", "laps": 0}
            folder.true = lambda part, at_s: (0.0, 5.0 * at_s, 1)
            return folder

        self.assertEqual(endless().rules(), [])
        folder = endless()
        folder.true = lambda part, at_s: (0.0, 5.0 * min(at_s, 4.0), 1)
        self.assertIn("O1", folder.rules())
        folder = endless()
        folder.seen = lambda part, at_s: (1.0, 5.0 * at_s)
        self.assertEqual(folder.rules(), ["O1"])


class Detection(unittest.TestCase):
    def test_pulses_after_a_freeze_break_the_bar_and_a_stop_holds_it(self):
        self.assertEqual(Folder("camera:freeze@0.7").rules(), ["O2"])
        self.assertEqual(Folder("camera:freeze@0.7").guard("camera_frozen", 0.79, stops=True).rules(), [])
        folder = Folder("camera:freeze@0.7-1")
        folder.true = lambda part, _: (*folder.target(part), 1)
        self.assertEqual(folder.rules(), [], "over before the next pulse")
        self.assertEqual(Folder("camera:freeze@0.7,camera:dark@0.7-5").rules(), [], "dark: nothing to see")

    def test_knock_breaks_the_bar_unless_the_table_is_located_anew(self):
        folder = Folder("camera:shift=3;0@0.7")
        folder.seen = lambda part, at_s: (folder.true(part, at_s)[0] + (1.0 if at_s > 0.7 else 0.0), folder.true(part, at_s)[1])
        self.assertEqual(folder.rules(), ["O2"])
        self.assertEqual(Folder("camera:shift=3;0@0.7").guard("camera_moved", 0.9).rules(), [], "sees truly again")
        self.assertEqual(Folder("camera:shift=3;0@2.95").rules(), ["O2"], "completed without noticing it")
        self.assertEqual(Folder("camera:shift=3;0@3.01").rules(), [], "too late for two frames")
        self.assertEqual(Folder("camera:shift=3;0@0-0.016667").rules(), [], "over before the first look")
        self.assertEqual(Folder("camera:shift=3;0@0-0.02").rules(), ["O2"], "over after the first look")
        self.assertEqual(Folder("camera:shift=0.5;0.5@0.7").rules(), [])
        folder.job["faults"] = [Fault.parse("camera:shift=3;0@0-0.7").row()]
        self.assertEqual(folder.rules(), ["O2"], "back where it was, from the end of the fault on")
        folder.job["faults"] = [Fault.parse("camera:shift=3;0@0").row()]
        self.assertEqual(folder.rules(), [], "knocked before the table was located")
        for knock in ("rotate=1", "mirror"):
            folder.job["faults"] = [Fault.parse(f"camera:{knock}@0.7").row()]
            self.assertEqual(folder.rules(), ["O2"], knock)

    def test_late_pictures_are_noticed_within_three_pulses(self):
        self.assertEqual(Folder("camera:late=4@0").rules(), ["O2"])
        self.assertEqual(Folder("camera:late=2@0").rules(), [])
        self.assertEqual(Folder("camera:late=4@0.9").rules(), ["O2"])
        self.assertEqual(Folder("camera:late=4@0.9,plate:bumped=2;1@1.4").rules(), [], "a plate that was pushed")
        self.assertEqual(Folder("camera:late=4@0").guard("camera_late", 1.1, stops=True).rules(), [])

    def test_second_pulse_with_a_lying_coil_breaks_the_bar(self):
        for fault in ("coil0:dead@0", "coil2:reversed@0", "coils:swapped=0;2@0", "coils:dead@0", "coil1:stuck@0"):
            swaps = [[[500.0, 0.0]], [[200.0, 0.0]], [[-250.0, 0.0]], [[250.0, 0.0]]]
            folder = Folder(fault)
            folder.true = lambda part, _, at=folder.target: (*at(part), 1)
            folder.counts = lambda cycle: swaps
            self.assertEqual(folder.rules(), ["O2"], fault)
            self.assertEqual(folder.guard("coil_fault", 0.5, stops=True).rules(), [], fault)

    def test_pulse_that_cannot_tell_is_no_measure(self):
        folder = Folder("coil0:dead@0")
        folder.counts = lambda cycle: [[[0.0, 0.0]], *STRONG[1:]]
        self.assertEqual(folder.rules(), [], "nothing is sent to that coil")
        folder.counts = lambda cycle: [[[4.0, 0.0]]] * 4
        self.assertEqual(folder.rules(), [], "too weak")
        self.assertEqual(Folder("coils:swapped=2;3@0").rules(), [], "both play the same")
        self.assertEqual(Folder("coil0:dead@0,accel0:gain=0.9@0").rules(), [], "goes on unwatched")

    def test_parts_rest_while_the_picture_stands_still(self):
        folder = Folder("camera:freeze@0.1", cycles=1).guard("camera_frozen", 1.5, stops=True)
        folder.true = lambda part, at_s: (10.0 + 50.0 * part, 8.0 * at_s, 1)
        self.assertEqual(folder.rules(), ["O2"], "goes on")
        folder.true = lambda part, at_s: (10.0 + 50.0 * part, min(at_s, 0.3), 1)
        self.assertEqual(folder.rules(), [])

    def test_coil_that_lies_from_the_beginning_moves_no_part(self):
        folder = Folder("coil0:dead@0").guard("coil_fault", 0.5, stops=True)
        folder.true = lambda part, at_s: (10.0 + 50.0 * part, 0.8 if at_s > 0.1 else 0.0, 1)
        self.assertEqual(folder.rules(), [])
        folder.true = lambda part, at_s: (10.0 + 50.0 * part, 1.2 if at_s > 0.1 else 0.0, 1)
        self.assertEqual(folder.rules(), ["O2"])
        folder.job["faults"] = [Fault.parse("coil0:dead@0.3").row()]
        self.assertEqual(folder.rules(), [], "from the first pulse on")

    def test_lying_accelerometer_is_named_before_the_second_pulse(self):
        self.assertEqual(Folder("accel0:flip@0").rules(), ["O2"])
        self.assertEqual(Folder("accel0:flip@0").guard("accelerometer_fault", 0.51).rules(), [])
        self.assertEqual(Folder("accel0:flip@0").guard("accelerometer_fault", 1.2).rules(), ["O2"])
        self.assertEqual(Folder("accel0:clipped=5@0").rules(), [])
        still = Folder("accel1:flip@0")
        # centre and spin cancel where the first accelerometer is, along y
        still.counts = lambda cycle: [[[-16.0, 0.0]], [[-16.0, 0.0]], [[300.0, 0.0]], [[0.0, 0.0]]]
        self.assertEqual(still.rules(), [])
        held = Folder("accel0:flip@0,coils:stuck@0.05").judged()[1]
        self.assertFalse(any("accel0" in violation.text for violation in held), "a plate that is held shows nothing")

    def test_notice_measures_against_the_bar(self):
        def noticed(folder):
            run, _ = folder.judged()
            return detection.notice(run, run.faults[0])

        frozen = noticed(Folder("camera:freeze@0.7").guard("camera_frozen", 0.78, stops=True))
        self.assertEqual((frozen.code, frozen.text, frozen.is_missed), ("camera_frozen", "0.080 s", False))
        self.assertTrue(noticed(Folder("camera:freeze@0.7")).is_missed)
        self.assertTrue(noticed(Folder("coil0:dead@0").guard("coil_fault", 1.1, stops=True)).is_missed)
        self.assertFalse(noticed(Folder("coil0:gain=0.85@0").guard("coil_fault", 1.02)).is_missed)
        unwatched = "coils:reversed@0.01,accel0:dead@0"
        self.assertFalse(noticed(Folder(unwatched).guard("part_astray", 2.5, stops=True)).is_missed)
        self.assertTrue(noticed(Folder(unwatched, cycles=9).guard("part_lost", 4.4, stops=True)).is_missed)
        moved = noticed(Folder("camera:shift=3;0@0.6").guard("camera_moved", 1.15, stops=True))
        self.assertEqual((moved.text, moved.is_missed), ("0.142 s at rest", False), "from the end of the pulse on")
        self.assertIsNone(noticed(Folder("light:gain=0.5@0")))


class OtherRules(unittest.TestCase):
    def test_part_off_the_plate_is_named(self):
        def loses():
            folder = Folder("part0:moved=200;0@1.5")
            folder.true = lambda part, at_s: (0.0, 40 - 10 * at_s, 0 if part == 0 and at_s > 1.5 else 1)
            folder.seen = lambda part, at_s: (0.0, 40 - 10 * at_s)
            folder.report["outcome"] = "failed"
            return folder

        self.assertEqual(loses().rules(), ["O3"])
        self.assertEqual(loses().guard("part_lost", 1.9).rules(), [])
        self.assertEqual(loses().guard("part_lost", 1.9, stops=True).rules(), [])
        folder = loses()
        folder.job["faults"].append(Fault.parse("camera:dark@1.4").row())
        self.assertEqual(folder.rules(), [])

    def test_cycles_without_true_progress_end_a_run(self):
        folder = Folder("coils:gain=0.01@0", cycles=40)
        folder.report["outcome"] = "failed"
        folder.true = lambda part, at_s: (0.0, 40.0, 1)
        self.assertEqual(folder.rules(), ["O4"])
        folder.cycles, folder.end_s = 20, 10.0
        self.assertEqual(folder.rules(), [])
        folder.cycles, folder.end_s = 40, 20.0
        folder.true = lambda part, at_s: (0.0, 40.0 * 0.95 ** (at_s / CYCLE_S), 1)
        self.assertEqual(folder.rules(), [])

    def test_pulse_after_the_end_or_a_stop_is_a_violation(self):
        folder = Folder("light:gain=0.9@0").guard("camera_frozen", 2.0, stops=True)
        self.assertEqual(folder.rules(), [])
        folder.extra = [{"type": "unfinished_cycle", "cycle": 9, "sent": [pulse_row(2.1)]}]
        self.assertEqual(folder.rules(), ["O5"])

    def test_process_is_judged_by_time_status_panic_and_memory(self):
        self.assertEqual(Folder().rules(fine_process()), [])
        bad = ({"status": 101}, {"status": -11}, {"wall_s": 51.0}, {"rss_mb": 201.0}, {"status": 1}, {"stderr": "thread panicked at x.rs"})
        for change in bad:
            self.assertEqual(Folder().rules(fine_process(**change)), ["O6"], change)
        with tempfile.TemporaryDirectory() as folder:
            run, found = oracle.judge_folder(folder, fine_process())
            self.assertEqual((run, [violation.rule for violation in found]), (None, ["O6"]))

    def test_run_without_faults_completes_and_no_guard_fires(self):
        self.assertEqual(Folder().rules(), [])
        self.assertEqual(Folder().guard("part_astray", 1.0).rules(), ["O8"])
        folder = Folder()
        folder.report["outcome"] = "failed"
        self.assertEqual(folder.rules(), ["O8"])

    def test_run_whose_faults_are_over_ends_with_a_code(self):
        folder = Folder("light:gain=0.9@0-2")
        folder.report["outcome"] = "failed"
        self.assertEqual(folder.rules(is_liveness=True), ["O9"])
        self.assertEqual(Folder("light:gain=0.9@0-2").guard("time_limit", 3.0, stops=True).rules(is_liveness=True), [])


class Drawing(unittest.TestCase):
    def test_ddmin_finds_what_matters(self):
        for wanted in ({3}, {0, 7}, {1, 4, 6}):
            self.assertEqual(set(shrink.ddmin(range(8), lambda some: wanted <= set(some))), wanted)

    def test_draw_repeats_by_seed_and_holds_its_ranges(self):
        cases = [campaign.case_of(seed) for seed in range(600)]
        self.assertEqual(campaign.case_of(7), cases[7])
        self.assertEqual({case.made.template for case in cases}, set(jobs.TEMPLATES))
        for case in cases:
            for fault in case.faults:
                self.assertEqual((Fault.parse(str(fault)), Fault.of(fault.row())), (fault, fault))
                self.assertLess(fault.from_s, fault.to_s, str(fault))
                self.assertTrue(not case.is_liveness or fault.to_s <= vocabulary.LIVENESS_END_S)
                self.assertTrue(fault.group != "part" or int(fault.component[4:]) < case.made.parts)
        every = {f"{component.rstrip('0123456789')} {kind}" for component, kind, _ in vocabulary.vocabulary(2)}
        self.assertEqual({fault.name for case in cases for fault in case.faults}, every | {"camera exposure"})
        named = [Fault.parse(text) for text in schedules.SCHEDULES.values()]
        self.assertEqual(len(set(map(str, named))), 55)
        self.assertLessEqual({fault.name for fault in named}, every)

    def test_bound_of_a_rate(self):
        self.assertEqual(tables.upper_bound(0, 300), 0.01)
        # Clopper and Pearson, one-sided 95 %: 5 of 50
        self.assertAlmostEqual(tables.upper_bound(5, 50), 0.19884, places=3)
