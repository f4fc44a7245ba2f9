#!/usr/bin/env python3
"""Many coins at once over many seeds: how many jobs get done, how fast, how exactly; the benchmark page of the README.

usage: many_coins.py [--seeds 20] [--jobs 2] [--only NAME ...] [--planner synthesized_field] [--spread 0.1] [--alone 5]
                     [--compare 10] [--compare-limit 120] [--plot many_coins.svg] [--upm target/debug/upm]

Every run is the whole loop on upm-2 with rendered frames, friction spread by --spread (relative standard deviation), starts at
random; seeds draw targets, too. Dense jobs (row-6-22 and so on) run when they are named. Prints a line a run, then tables:

  jobs        --seeds runs of each job, --jobs at once, and the bars that they miss; errors of predictions and speed are medians
  alone       --alone runs of arrange-8 and arrange-16 one at a time on one core: planning times, with the p99 over the cycles
              of all runs, and speed; of one job with recording, too, rotations on all cores.
  comparison  --compare runs of the arrange jobs with each of the other planners, from the same starts to the same targets; a
              run of more than --compare-limit s of plate time is not done. --plot shows the plate times side by side.

Exit status 1 when a bar is missed.
"""
import json
import math
import os
import pathlib
import random
import re
import statistics
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))
from common import ROOT, config, output_of, parser_of, percentile, speed_of, table  # noqa: E402

APART_MM, MARGIN_MM, WIDEST_MM = 25.4, 5.0, 24.26
FIELD_P99_MS = {"arrange-8": 2.0, "arrange-16": 6.0}

# the bars of sequences of rotations: median plate time, planning of a new sequence and of a correction
ROTATIONS = "cor_sequence"
ROTATION_MEDIAN_S = {
    "arrange-2": 6.0, "arrange-4": 14.0, "arrange-8": 36.0, "arrange-16": 150.0,
    "sort-8": 40.0, "sort-12": 120.0, "swap-2": 6.0, "ring-6": 35.0, "bowtie-3": 200.0,
}  # fmt: skip
# motions without pauses
MOVING = "moving_field"
MOVING_MEDIAN_S = {
    "arrange-2": 1.6, "arrange-4": 1.8, "arrange-8": 3.0, "arrange-16": 8.0, "arrange-24": 25.0, "arrange-32": 60.0,
    "sort-8": 3.5, "sort-12": 8.0, "letters-16": 15.0, "grid-20-22": 60.0, "line-10": 8.0,
}  # fmt: skip
MOVING_WORST_S = {"arrange-2": 3.0, "arrange-4": 3.0, "arrange-8": 6.0, "arrange-16": 16.0}
MOVING_P99_MS = {"arrange-8": 15.0, "arrange-16": 30.0}
MEDIAN_S = {ROTATIONS: ROTATION_MEDIAN_S, MOVING: MOVING_MEDIAN_S}
ROTATION_P99_MS = {"arrange-8": (80.0, 3.0), "arrange-16": (250.0, 10.0)}
# the job that is recorded, and its bar
RECORDED = {ROTATIONS: ("arrange-16", 10.0), "synthesized_field": ("arrange-8", 15.0), MOVING: ("arrange-8", 5.0)}

KINDS = {"plan_ms": "planning", "new_ms": "planning a new sequence", "correction_ms": "correcting a sequence"}

# by what they are called in jobs, in the order of the comparison
PLANNERS = {
    "pseudo_inverse": "pseudo-inverse, 2N fixed centres",
    "cor_sequence": "COR sequences",
    "synthesized_field": "synthesised fields",
    "moving_field": "without pauses",
}


def arrange(parts):
    def make(rng):
        task = {"type": "arrange", "targets_mm": scattered(rng, parts, APART_MM)}
        return [{"kind": "penny", "count": parts}], task

    return make


def shipped(name):
    def make(_):
        job = config(name)
        return job["parts"], job["task"]

    return make


def swap(rng):
    places = scattered(rng, 2, 60.0)
    parts = [{"kind": kind, "position_mm": place} for kind, place in zip(("penny", "quarter"), places)]
    return parts, {"type": "arrange", "targets_mm": places[::-1], "assignment": "fixed"}


def ring(rng):
    places = circle(6, rng.uniform(50.0, 100.0), rng.uniform(0.0, 2.0 * math.pi))
    parts = [{"kind": "penny", "position_mm": place} for place in places]
    return parts, {"type": "arrange", "targets_mm": places[1:] + places[:1], "assignment": "fixed"}


def placed(targets_mm):
    """Pennies from random starts to these places."""
    return lambda _: ([{"kind": "penny", "count": len(targets_mm)}], {"type": "arrange", "targets_mm": targets_mm})


def grid(columns, rows, pitch_mm):
    """Places about the middle of the plate, row by row."""
    middle = (columns - 1) / 2, (rows - 1) / 2
    return [[pitch_mm * (column - middle[0]), pitch_mm * (row - middle[1])] for row in range(rows) for column in range(columns)]


def circle(count, radius_mm, turn=0.0):
    angles = [turn + k * 2.0 * math.pi / count for k in range(count)]
    return [[radius_mm * math.cos(angle), radius_mm * math.sin(angle)] for angle in angles]


def scattered(rng, count, apart_mm):
    """Places at random, `apart_mm` apart, where even a quarter's rim is MARGIN_MM inside the edge of upm-2."""
    side_mm = config("rigs/upm-2")["plate"]["side_mm"]
    reach_mm = 0.5 * (side_mm - WIDEST_MM) - MARGIN_MM
    places = []
    while len(places) < count:
        place = [rng.uniform(-reach_mm, reach_mm) for _ in range(2)]
        if all(math.dist(place, other) >= apart_mm for other in places):
            places.append(place)
    return places


@dataclass
class Job:
    """A job and its bars; the most that a figure of the report may be over all runs, by key."""

    make: object
    share: float = 1.0
    median_s: float | None = None
    most: dict = field(default_factory=dict)
    limit_s: float = 300.0


EXACT = {"collisions": 0, "lost_parts": 0, "max_error_mm": 0.5}
JOBS = {
    **{f"arrange-{n}": Job(arrange(n), median_s=s, most=EXACT) for n, s in ((2, 6.0), (4, 10.0), (8, 22.0), (16, 50.0))},
    "arrange-24": Job(arrange(24), share=0.9, limit_s=600.0),
    "sort-8": Job(shipped("sort-8"), median_s=25.0),
    "sort-12": Job(shipped("sort-12"), median_s=40.0),
    "swap-2": Job(swap, most={"collisions": 0}),
    "ring-6": Job(ring, most={"collisions": 0}),
    "bowtie-3": Job(shipped("bowtie-3"), most={"phase_error_max": 0.05, "cross_track_rms_mm": 0.35}, limit_s=900.0),
}
# places that leave little between the pennies (19 mm), and more of them; run when they are named
DENSE = {
    **{f"row-{n}-22": Job(placed(grid(n, 1, 22.0)), share=0.0) for n in (6, 8)},
    "octagon-8": Job(placed(circle(8, 32.0)), share=0.0),
    **{f"grid-{3 * n}-{mm:.0f}": Job(placed(grid(n, 3, mm)), share=0.0, limit_s=600.0) for n, mm in ((3, 24.0), (4, 25.0), (4, 32.0))},
    "arrange-32": Job(arrange(32), most=EXACT, limit_s=600.0),
    "letters-16": Job(shipped("letters-16"), most=EXACT),
    "grid-20-22": Job(placed(grid(5, 4, 22.0)), most=EXACT, limit_s=600.0),
    "line-10": Job(shipped("line-10"), most=EXACT),
}
JOBS |= DENSE


@dataclass
class Bench:
    upm: str
    folder: str
    spread: float

    def job_file(self, name, planner, seed, most_s):
        rig = config("rigs/upm-2")
        rig["friction"]["spread"] = self.spread
        rig["library"] = str(ROOT / "assets/libraries/upm-2.json")
        # a seed of text gives the same numbers on every machine and version
        parts, task = JOBS[name].make(random.Random(f"{name} {seed}"))
        job = {"name": name, "seed": seed, "rig": rig, "parts": parts, "task": task, "planner": planner}
        job["limits"] = {"plate_time_s": min(JOBS[name].limit_s, most_s)}
        path = pathlib.Path(self.folder) / f"{name}-{planner}-{seed}.json"
        path.write_text(json.dumps(job))
        return str(path)

    def run(self, name, planner, seed, most_s=math.inf, rerun="off", one_core=False):
        """The report of a run, with the planning time of every cycle added; for a job that is refused one with nothing
        but the reason."""
        job = self.job_file(name, planner, seed, most_s)
        command = [self.upm, "run", job, "--seed", seed, "--out", self.folder, "--rerun", rerun, "--json", "-vv"]
        pin = (lambda: os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})) if one_core else None
        report, told = output_of(command, (0, 1, 2), preexec_fn=pin)
        if not report:
            return {"outcome": "refused", "reason": told.strip()}
        plans = re.findall(r"\bcontinues=(\w+) plan_us=([\d.]+)", told)
        times = {"plan_ms": [1e-3 * float(us) for _, us in plans]}
        times["new_ms"] = [1e-3 * float(us) for continues, us in plans if continues == "false"]
        times["correction_ms"] = [1e-3 * float(us) for continues, us in plans if continues == "true"]
        return json.loads(report) | times

    def campaign(self, names, planner, seeds, at_once, most_s=math.inf):
        """Reports by name, each told as it comes; no run takes more than `most_s` of plate time."""
        print(f"\n{PLANNERS[planner]}\n{HEAD}", flush=True)
        with ThreadPoolExecutor(at_once) as pool:
            wanted = [(name, seed) for name in names for seed in range(1, seeds + 1)]
            runs = [(name, seed, pool.submit(self.run, name, planner, seed, most_s)) for name, seed in wanted]
            reports = {name: [] for name in names}
            for name, seed, pending in runs:
                reports[name].append(pending.result())
                print(line(name, seed, reports[name][-1]), flush=True)
        return reports


def value(report, *keys):
    """A figure of a report by its keys, None where it has none."""
    for key in keys:
        report = report.get(key) if isinstance(report, dict) else None
    return report


def values(reports, *keys):
    return [found for found in (value(report, *keys) for report in reports) if found is not None]


def over(summary, found):
    return summary(found) if found else None


def shown(found, digits=1, width=9):
    return f"{'-' if found is None else format(found, f'.{digits}f'):>{width}}"


HEAD = "job         seed outcome      plate s  touch   lost   err mm path rms   phase  times  reason"


def line(name, seed, report):
    counts = "".join(shown(value(report, key), 0, 7) for key in ("collisions", "lost_parts"))
    errors = "".join(shown(value(report, key), 3) for key in ("max_error_mm", "cross_track_rms_mm", "phase_error_max"))
    plate_s, times = shown(value(report, "plate_time_s")), shown(speed_of(report), 1, 7)
    return f"{name:11} {seed:4d} {report['outcome']:10s} {plate_s}{counts}{errors}{times}  {report['reason']}"


def completed(reports, most_s=math.inf):
    """Those that were done, in `most_s` of plate time."""
    return [report for report in reports if report["outcome"] == "completed" and report["plate_time_s"] <= most_s]


def median_s(reports, most_s=math.inf):
    """Median plate time, a run that is not done counted as endless; None when most are not."""
    done_s = [report["plate_time_s"] for report in completed(reports, most_s)]
    median = statistics.median(done_s + [math.inf] * (len(reports) - len(done_s)))
    return median if math.isfinite(median) else None


def misses(name, reports):
    """Bars of a job that its runs do not hold."""
    job, done = JOBS[name], completed(reports)
    if len(done) < job.share * len(reports):
        yield f"{name}: {len(done)} of {len(reports)} done, bar {math.ceil(job.share * len(reports))}"
    if job.median_s is not None and (median_s(reports) or math.inf) > job.median_s:
        yield f"{name}: median plate time {shown(median_s(reports), 1, 0)} s, bar {job.median_s:g}"
    for key, most in job.most.items():
        found = values(reports, key)
        if len(found) < len(reports):
            yield f"{name}: {key} not reported in {len(reports) - len(found)} runs, bar {most:g}"
        if found and max(found) > most:
            yield f"{name}: {key} {max(found):g}, bar {most:g}"


def print_jobs(campaign, at_once):
    print(f"\njobs, {at_once} at once; largest errors, median of predicted errors and of speeds")
    head = ("job", "done", "touch", "lost", "err mm", "median s", "bar", "worst s", "library", "learned", "path rms", "phase", "times")
    rows = []
    for name, reports in campaign.items():
        done = completed(reports)
        figures = [
            (over(sum, values(reports, "collisions")), 0),
            (over(sum, values(reports, "lost_parts")), 0),
            (over(max, values(done, "max_error_mm")), 3),
            (median_s(reports), 1),
            (JOBS[name].median_s, 0),
            (over(max, values(done, "plate_time_s")), 1),
            *((over(statistics.median, values(reports, "prediction_error_mm", of)), 3) for of in ("library", "learned")),
            *((over(max, values(reports, key)), 3) for key in ("cross_track_rms_mm", "phase_error_max")),
            (over(statistics.median, [s for s in map(speed_of, reports) if s]), 1),
        ]
        rows.append([name, f"{len(done)}/{len(reports)}", *(shown(figure, digits, 0) for figure, digits in figures)])
    print("\n".join(table(head, rows)))


def alone(bench, names, planner, seeds):
    """One run at a time on one core: planning times and speed, with recording too. Yields the bars that are missed."""
    print(f"\none at a time on one core, {seeds} runs each")
    for name in names:
        reports = [bench.run(name, planner, seed, one_core=True) for seed in range(1, seeds + 1)]
        field_ms = (MOVING_P99_MS if planner == MOVING else FIELD_P99_MS)[name]
        bars = zip(("new_ms", "correction_ms"), ROTATION_P99_MS[name]) if planner == ROTATIONS else [("plan_ms", field_ms)]
        for key, bar in bars:
            cycles = [ms for found in values(reports, key) for ms in found]
            of_all, median = (shown(over(figure, cycles), 2, 0) for figure in (lambda ms: percentile(ms, 0.99), statistics.median))
            print(f"{name:11} {KINDS[key]} p99 {of_all} ms of {len(cycles)} cycles, bar {bar:g}; median {median}")
            if not cycles or percentile(cycles, 0.99) > bar:
                yield f"{name}: {KINDS[key]} p99 {of_all} ms, bar {bar:g}"
        print(f"{name:11} without recording {speeds(reports)}", flush=True)
    recorded, bar = RECORDED.get(planner, (None, 0.0))
    if recorded in names:
        # a recording is written beside the loop: rotations are held to their bar as people run them, on all cores
        one_core = planner != ROTATIONS
        reports = [bench.run(recorded, planner, seed, rerun="save", one_core=one_core) for seed in range(1, seeds + 1)]
        found = [times for times in map(speed_of, reports) if times]
        print(f"{recorded:11} with recording {speeds(reports)}, bar {bar:g}", flush=True)
        if not found or statistics.median(found) < bar:
            yield f"{recorded}: with recording {speeds(reports)}, bar {bar:g}"


def speeds(reports):
    found = [times for times in map(speed_of, reports) if times]
    median, slowest = shown(over(statistics.median, found), 1, 0), shown(over(min, found), 1, 0)
    return f"{median} times plate time, median, slowest {slowest}"


def print_comparison(campaigns, names, most_s):
    """`campaigns`: reports by job, by planner."""
    print(f"\ncomparison; a run of more than {most_s:g} s of plate time counts as not done")
    for name in names:
        for planner, reports in ((planner, campaign[name]) for planner, campaign in campaigns.items()):
            median, lost = median_s(reports, most_s), sum(values(reports, "lost_parts"))
            time = "most not done" if median is None else f"{median:.1f} s"
            print(f"{name:11} {PLANNERS[planner]:32} {len(completed(reports, most_s))} of {len(reports)}, {time}, {lost} lost")


def plot(campaigns, names, most_s):
    """An SVG: plate time of every run that was done, a column of dots for each planner, with the median as a line."""
    width, bottom = 70 + 150 * len(names), 300
    y = lambda s: bottom - 100 * math.log10(s / 0.5)
    text = lambda x, y, words, more="": f'<text x="{x}" y="{y:.1f}" {more}>{words}</text>'
    rule = lambda x, to, y, stroke: f'<path d="M{x} {y:.1f}H{to}" stroke="{stroke}"/>'
    marks = [text(4, 16, "plate time, s")]
    for s in (1, 2, 5, 10, 20, 50, 100):
        marks += [rule(40, width, y(s), "#ddd"), text(34, y(s) + 4, s, 'text-anchor="end"')]
    for i, (color, (planner, campaign)) in enumerate(zip(("#14685c", "#8a8f98", "#1b5fc1", "#b8702a"), campaigns.items())):
        marks.append(text(40, bottom + 40 + 16 * i, f"● {PLANNERS[planner]}", f'fill="{color}"'))
        for x, name in zip(range(64 + 30 * i, width, 150), names):
            median, done = median_s(campaign[name], most_s), completed(campaign[name], most_s)
            marks += [f'<circle cx="{x}" cy="{y(run["plate_time_s"]):.1f}" r="2.5" fill="{color}" fill-opacity="0.5"/>' for run in done]
            marks += [rule(x - 10, x + 10, y(median), color)] if median else []
    marks += [text(79 + 150 * i, bottom + 18, name) for i, name in enumerate(names)]
    frame = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {bottom + 120}" style="font: 12px sans-serif">'
    return "\n".join([frame, '<rect width="100%" height="100%" fill="#fff"/>', *marks, "</svg>\n"])


def main():
    parser = parser_of(__doc__, seeds=20, jobs=2, spread=0.1, alone=5, compare=10, compare_limit=120.0, plot="many_coins.svg")
    parser.add_argument("--only", nargs="+", choices=JOBS, default=[name for name in JOBS if name not in DENSE], metavar="NAME")
    parser.add_argument("--planner", choices=PLANNERS, default="synthesized_field")
    args = parser.parse_args()

    names = [name for name in JOBS if name in args.only]
    for name, bar in MEDIAN_S.get(args.planner, {}).items():
        JOBS[name].median_s = bar
    for name, bar in (MOVING_WORST_S if args.planner == MOVING else {}).items():
        JOBS[name].most = JOBS[name].most | {"plate_time_s": bar}
    compared = [name for name in names if name.startswith("arrange-") and JOBS[name].median_s] if args.compare else []
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(args.upm, folder, args.spread)
        ours = bench.campaign(names, args.planner, args.seeds, args.jobs)
        print_jobs(ours, args.jobs)
        missed = [miss for name, reports in ours.items() for miss in misses(name, reports)]
        timed = [name for name in FIELD_P99_MS if name in names] if args.alone else []
        if timed:
            missed += alone(bench, timed, args.planner, args.alone)
        if compared:
            campaigns = {args.planner: ours}
            for other in (planner for planner in PLANNERS if planner != args.planner):
                campaigns[other] = bench.campaign(compared, other, args.compare, args.jobs, args.compare_limit)
            print_comparison(campaigns, compared, args.compare_limit)
            pathlib.Path(args.plot).write_text(plot(campaigns, compared, args.compare_limit))
    print("\nbars held" if not missed else "\nbars missed\n  " + "\n  ".join(missed))
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
