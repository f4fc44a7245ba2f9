"""Tests of the rules of the daemon tier: answers made by hand, for each rule one that breaks it and one that does not."""
import json
import re
import tempfile
import unittest

from . import daemon_tier, jobs, pausing, schedules, served
from .pausing import End, Left, Stop

DONE, DARK = End("completed", None, 3.2), End("failed", "camera_dark", 5.7)
CAUSE = {"code": "camera_dark", "text": "the camera's frames show no plate", "remedy": "check the light"}
SILENT = {"silent": True, "persisted": True, "requested_at_s": 1.2, "silent_at_s": 1.20005}


def paused(cause=CAUSE):
    return {"state": "paused", "pause": cause}


def idle():
    return {"state": "idle", "pause": None}


def held(plate=None, waiting="queued", then=DONE, resumed=200):
    """A paused plate whose next job waits and completes after `resume`."""
    return Left(paused() if plate is None else plate, waiting, then, resumed)


def went_on():
    return Left(idle(), "completed", DONE)


def rules(alone, end, left):
    return sorted({violation.rule for violation in pausing.violations(alone, end, left)})


class Pauses(unittest.TestCase):
    def test_ends_plates_and_next_jobs_are_judged(self):
        nameless, watchdog = End("failed", None, 1.1), End("failed", "no_part_seen", 1.1)
        for alone, end, left, expected in [
            (DARK, DARK, held(), []),
            (DARK, DARK, went_on(), ["O7"]),
            (DONE, DONE, went_on(), []),
            (DONE, DONE, held(), ["O7"]),
            (nameless, nameless, held(paused(CAUSE)), ["O7"]),
            (DARK, DARK, held(paused(CAUSE | {"code": "view_hidden"})), ["O7"]),
            (DARK, DARK, held(waiting="running"), ["O7"]),
            (DARK, DARK, held(waiting="completed"), ["O7"]),
            (DARK, DARK, held(then=DARK), ["O9"]),
            (DONE, DONE, Left(idle(), "failed", DARK), ["O9"]),
            (DARK, DARK, held(resumed=409), ["O9"]),
            (DARK, watchdog, held(paused(CAUSE | {"code": "no_part_seen"})), ["O10"]),
            (DONE, DARK, held(), ["O10"]),
            (End("failed", "camera_dark", 5.75), DARK, held(), ["O10"]),
        ]:
            self.assertEqual(rules(alone, end, left), expected, (alone, end, left))
        for cause in (None, "camera_dark", {}, CAUSE | {"code": None}, CAUSE | {"remedy": " "}, {"code": "camera_dark"}):
            self.assertEqual(rules(DARK, DARK, held(paused(cause))), ["O7"], cause)

    def test_codes_of_the_documentation_and_unknown_ones_pause(self):
        guards = (jobs.ROOT / "docs/faults.md").read_text().partition("## Guards")[2].partition("\n## ")[0]
        rows = [line for line in guards.splitlines() if line.startswith("| `")]
        self.assertGreaterEqual(len(rows), 18)
        for row in rows:
            code = re.findall(r"`(\w+)`", row)[0]
            self.assertEqual(pausing.must_pause(End("failed", code)), "the plate goes on" not in row, code)
        for code in (None, "of_next_year"):
            self.assertTrue(pausing.must_pause(End("failed", code)), code)
        for end in (DONE, End("cancelled"), *(End("failed", code) for code in pausing.GOES_ON)):
            self.assertFalse(pausing.must_pause(end), end)


class EmergencyStops(unittest.TestCase):
    def rules(self, end=End("cancelled", None, 1.2), plate="stopped", left=None, **changes):
        whole = {"answer": SILENT, "refused": (409, 409), "held": {"state": plate}, "step_s": 5e-5, "pulses_s": (0.1, 1.1)}
        found = pausing.estop_violations(end, Stop(**(whole | changes)), left or held())
        return sorted({violation.rule for violation in found})

    def test_stops_are_judged(self):
        self.assertEqual(self.rules(), [])
        for change in ({"silent": False}, {"persisted": False}, {"silent_at_s": 1.2002}):
            self.assertEqual(self.rules(answer=SILENT | change), ["O5"], change)
        self.assertEqual(self.rules(pulses_s=(0.1, 1.3)), ["O5"])
        for changes in ({"end": DARK}, {"plate": "paused"}, {"refused": (200, 409)}, {"refused": (409, 201)}, {"left": went_on()}):
            self.assertEqual(self.rules(**changes), ["O7"], changes)


class Cases(unittest.TestCase):
    def test_cases_are_the_schedules_in_their_jobs(self):
        cases = daemon_tier.cases_of(3, 1, None)
        self.assertEqual(len(cases), 3 * len(schedules.SCHEDULES))
        self.assertEqual(cases[0].made, schedules.made_for("arr4", 1))

    def test_plates_hold_the_rigs_of_their_cases(self):
        cases = daemon_tier.cases_of(3, 2, ["frozen"])
        plates, free = daemon_tier.plates_for(cases, 2)
        self.assertEqual(sum(each.qsize() for each in free.values()), len(plates))
        for case in cases:
            self.assertEqual(plates[f"{case.rig}-1"], case.made.job["rig"])
        self.assertLessEqual(len(daemon_tier.plates_for(cases, 64)[0]), daemon_tier.MOST_PLATES)

    def test_configuration_has_the_plates_and_allows_faults(self):
        with tempfile.TemporaryDirectory() as folder:
            spec = json.loads(served.Served("upm", folder, {"a": {"name": "upm-1"}}).config.read_text())
        self.assertTrue(spec["allow_faults"])
        self.assertEqual(spec["plates"], [{"name": "a", "rig": {"name": "upm-1"}}])
