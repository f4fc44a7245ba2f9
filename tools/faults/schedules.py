"""The 55 named schedules of the first campaign by hand, each in some jobs and seeds, against the bars of their classes."""
import json
import pathlib
import random
import re
import subprocess
import tempfile

from . import jobs
from .vocabulary import Fault

JOBS = ("arr4", "swap", "endless", "sort8", "arr1")

# name: schedule; the first twelve are the regressions that every build starts with
SCHEDULES = {
    "knocked 3 px": "camera:shift=3;0@0.5",
    "knocked 120 px": "camera:shift=120;0@0.5",
    "late 6": "camera:late=6@0",
    "frozen": "camera:freeze@0.5",
    "frozen at 3 s": "camera:freeze@3",
    "coils dead at 3 s": "coils:dead@3",
    "coil 0 reversed": "coil0:reversed@1",
    "x coils swapped": "coils:swapped=0;1@0",
    "coil 0 dead": "coil0:dead@1",
    "ghost": "view:ghost=30;-60@0.5",
    "part 0 glued": "part0:glued@0",
    "hand 1 s": "view:hand=0.33@0.5-1.5",
    "knocked 10;5 px": "camera:shift=10;5@0.5",
    "knocked 40 px": "camera:shift=40;0@0.5",
    "knocked for 1 s": "camera:shift=10;5@0.5-1.5",
    "knocked 2 deg": "camera:rotate=2@0.5",
    "mirrored": "camera:mirror@0.5",
    "late 3": "camera:late=3@0",
    "late 12": "camera:late=12@0",
    "late 12 from 1 s": "camera:late=12@1",
    "frozen for 1 s": "camera:freeze@0.5-1.5",
    "dark 0.3 s": "camera:dark@0.5-0.8",
    "dark 0.5 s": "camera:dark@0.5-1",
    "dark": "camera:dark@0.5",
    "garbage 0.3 s": "camera:garbage@0.5-0.8",
    "garbage 0.5 s": "camera:garbage@0.5-1",
    "garbage": "camera:garbage@0.5",
    "half the frames lost": "camera:drop=0.5@0",
    "nine of ten frames lost": "camera:drop=0.9@0",
    "light to 10 %": "light:gain=0.1@0.5",
    "light flickers": "light:flicker=7@0",
    "hand over a half, 2 s": "view:hand=0.5@0.5-2.4",
    "hand stays": "view:hand=0.33@0.5",
    "ghost from the start": "view:ghost=30;-60@0",
    "coils dead": "coils:dead@0",
    "coils dead at 1 s": "coils:dead@1",
    "coils reversed": "coils:reversed@0",
    "coil 0 reversed from the start": "coil0:reversed@0",
    "coil 2 reversed": "coil2:reversed@1",
    "x and y coils swapped": "coils:swapped=0;2@0",
    "coils swapped at 1 s": "coils:swapped=1;3@1",
    "coil 0 dead from the start": "coil0:dead@0",
    "coil 2 dead": "coil2:dead@1",
    "coil 0 at 85 %": "coil0:gain=0.85@0",
    "coil 0 at 60 %": "coil0:gain=0.6@0",
    "coil 0 at 120 %": "coil0:gain=1.2@0",
    "accelerometer 0 dead": "accel0:dead@0",
    "accelerometer 1 flipped": "accel1:flip@0",
    "accelerometer 0 garbage": "accel0:garbage@0",
    "part 0 on ice": "part0:ice@0",
    "part 0 moved": "part0:moved=8;5@0.5",
    "friction x 0.2": "part0:friction=0.2@0",
    "friction x 5": "part0:friction=5@0",
    "part 0 taken off": "part0:removed@1",
    "plate bumped": "plate:bumped=3;-2@0.5",
}
FIELDS = "synthesized_field"


def made_for(template, seed, planner=FIELDS):
    """The job of a template and seed."""
    rig = "upm-1" if template == "endless" and seed % 2 else "upm-2"
    planner = {"upm-1": "cor_sequence", "upm-2": FIELDS if template == "endless" else planner}[rig]
    return jobs.make(random.Random(seed), template, rig, planner, seed)


def chosen(names, only):
    """The names that hold one of the words `only`, or all of them."""
    return [name for name in names if not only or any(word in name for word in only)]


def campaign_of(seed, templates, only, planner):
    """A campaign of one seed: a cell for each schedule in each job."""
    jobs_of = []
    for name in chosen(SCHEDULES, only):
        for template in templates:
            made = made_for(template, seed, planner).job
            faults = [Fault.parse(text).row() for text in SCHEDULES[name].split(",")]
            jobs_of.append(made | {"name": re.sub(r"[^\w.]+", "-", f"{name} {template}"), "faults": faults})
    return {"name": f"schedules-{seed}", "seeds": str(seed), "camera": "pixels", "job": {"$each": jobs_of}}


def run_all(upm, judge, jobs_per, seeds, at_once, only, planner):
    """Runs all schedules as campaigns and prints a row a cell; true when no rule is broken and no bar missed."""
    good = True
    with tempfile.TemporaryDirectory(prefix="upm-schedules-") as scratch:
        for seed in range(1, seeds + 1):
            file, out = (pathlib.Path(scratch) / f"{seed}{ending}" for ending in (".json", ""))
            file.write_text(json.dumps(campaign_of(seed, JOBS[:jobs_per], only, planner)))
            command = [upm, "campaign", file, "--out", out, "--jobs", str(at_once), "--judge", judge]
            good &= subprocess.run(command).returncode == 0
    return good
