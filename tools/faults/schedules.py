"""The 55 named schedules of the first campaign by hand, each in some jobs and seeds, against the bars of their classes."""
import math
import pathlib
import random
import shutil
import tempfile
from concurrent.futures import ThreadPoolExecutor

from common import table
from . import detection, jobs, oracle
from .vocabulary import Fault, harmless

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
# nothing to notice, and the run goes on: a hand that is gone after two seconds
GOES_ON = ("hand 1 s", "hand over a half, 2 s")


def made_for(template, seed, planner=FIELDS):
    """The job of a template and seed."""
    rig = "upm-1" if template == "endless" and seed % 2 else "upm-2"
    planner = {"upm-1": "cor_sequence", "upm-2": FIELDS if template == "endless" else planner}[rig]
    return jobs.make(random.Random(seed), template, rig, planner, seed)


def chosen(names, only):
    """The names that hold one of the words `only`, or all of them."""
    return [name for name in names if not only or any(word in name for word in only)]


def rows_of(runner, name, template, seeds, scratch, planner):
    """A row a run, and what was missed in it."""
    faults = [Fault.parse(text) for text in SCHEDULES[name].split(",")]
    for seed in seeds:
        made = made_for(template, seed, planner)
        folder = pathlib.Path(scratch) / f"{name} {template} {seed}".replace(" ", "-").replace("/", "-")
        run_folder, process = runner.run(made.job, faults, folder)
        if run_folder is None:
            yield [name, template, seed, "refused", "-", "-", "-", process.stderr.strip()[:60]], ["refused"]
            continue
        run, found = oracle.judge_folder(run_folder, process)
        shutil.rmtree(folder, ignore_errors=True)
        if run is None:
            yield [name, template, seed, "unreadable", "-", "-", "-", str(found[0])[:60]], ["unreadable"]
            continue
        yield row_of(run, name, template, seed, faults, found)


def row_of(run, name, template, seed, faults, found):
    notices = [detection.notice(run, fault) for fault in faults]
    seen = "; ".join(f"{n.code or 'never'} {n.text}{' MISSED' if n.is_missed else ''}" for n in notices if n) or "-"
    codes = ",".join(sorted({guard["code"] for guard in run.guards})) or "-"
    broken = [violation for violation in found if not violation.is_unobservable]
    missed = [f"{run.stop_code or run.outcome}: {violation}" for violation in broken]
    missed += [f"bar missed: {fault} noticed {n.code or 'never'}, {n.text}" for fault, n in zip(faults, notices) if n and n.is_missed]
    if name in GOES_ON and run.outcome != "completed":
        missed.append(f"{run.outcome}, and should wait and go on")
    outcome = run.outcome if not run.stop_code else f"{run.outcome}: {run.stop_code}"
    return [name, template, seed, outcome, worst_error(run), seen, codes, " ".join(sorted({v.rule for v in broken})) or "-"], missed


def worst_error(run):
    """The largest true error at the end, mm, in words; without targets that between the last look and the truth then."""
    at = run.final_truth()
    if at is None or not run.cycles:
        return "-"
    if not all(part[2] for part in at):
        return "off plate"
    if run.job["task"]["type"] != "plus_sign":
        return f"{max(math.dist(part['target_mm'], place[:2]) for part, place in zip(run.report['parts'], at)):.2f}"
    cycle = run.cycles[-1]
    return f"{math.dist(cycle['observed_mm'][0], run.truth_at(cycle['observed_at_s'])[0][:2]):.2f}"


def run_all(runner, jobs_per, seeds, at_once, only, planner):
    """Runs all schedules and prints a row a run; true when no run is a false success and no bar is missed."""
    head = ["schedule", "job", "seed", "outcome", "true mm", "noticed (against its bar)", "guards", "violations"]
    rows, bad = [], []
    with tempfile.TemporaryDirectory(prefix="upm-schedules-") as scratch, ThreadPoolExecutor(at_once) as pool:
        wanted = [(name, template) for name in chosen(SCHEDULES, only) for template in JOBS[:jobs_per]]
        pending = [pool.submit(lambda w: list(rows_of(runner, *w, range(1, seeds + 1), scratch, planner)), w) for w in wanted]
        for done, future in enumerate(pending, 1):
            for row, missed in future.result():
                rows.append(row)
                bad += [(row[0], row[1], row[2], text) for text in missed]
            if done % 15 == 0:
                print(f"{done} of {len(pending)} pairs of schedule and job, {len(bad)} misses", flush=True)
    print("\n".join(table(head, rows)))
    harmless_rows = [row for row in rows if all(harmless(Fault.parse(text)) for text in SCHEDULES[row[0]].split(","))]
    stopped = [row for row in harmless_rows if not row[3].startswith("completed")]
    print(f"\n{len(rows)} runs; harmless faults {len(harmless_rows)}, of which {len(stopped)} stopped needlessly")
    print(f"{len(bad)} violations and missed bars")
    for name, template, seed, text in bad:
        print(f"  {name}, {template}, seed {seed}: {text}")
    return not bad
