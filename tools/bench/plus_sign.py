#!/usr/bin/env python3
"""The plus-sign task over many seeds: how often it completes, how well the path is kept, how fast the loop runs.

usage: plus_sign.py [--seeds 50] [--laps 3] [--rig upm-1] [--planner auto] [--jobs 2] [--upm target/debug/upm]

Every run is the whole loop: each frame at 60/s rendered and looked at. Prints one line a seed and a summary with the bars
of the task; exit status 1 when one is missed. Distances from the path are true ones, over all frames.
"""
import json
import math
import pathlib
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))
from common import ROOT, Bars, config, parser_of, percentile, report_of, speed_of  # noqa: E402

# largest figures of a run's report
MOST = {"cross_track_max_mm": 0.6, "travel_ratio": 1.03, "sensing_rms_error_mm": 0.10}
# mm rms over all runs; plate time of a lap on upm-1, the way to the centre included, s
CROSS_MM, LAP_S = 0.20, 1.15 * 88


def line(seed, report):
    figures = [report["laps"], report["plate_time_s"], report["pulses"], report["cross_track_rms_mm"]]
    figures += [report[key] for key in MOST] + [speed_of(report)]
    cells = "".join(f"{'-' if figure is None else format(figure, '.4g'):>9}" for figure in figures)
    return f"{seed:5d} {report['outcome']:10s}{cells}  {report['reason']}"


def judge(reports, laps, at_once):
    bars = Bars()
    completed = sum(report["outcome"] == "completed" for report in reports)
    bars.hold("runs completed", len(reports), completed, completed == len(reports))
    lost = sum(report["lost_parts"] for report in reports)
    bars.hold("lost parts", 0, lost, lost == 0)
    driven = [report for report in reports if report["cross_track_rms_mm"] is not None]
    frames = sum(report["frames"] for report in driven)
    cross = math.sqrt(sum(report["cross_track_rms_mm"] ** 2 * report["frames"] for report in driven) / max(frames, 1))
    bars.hold("cross-track over all runs, mm rms", CROSS_MM, f"{cross:.3f}", cross <= CROSS_MM)
    bars.tell("  worst run", f"{max((r['cross_track_rms_mm'] for r in driven), default=math.nan):.3f}")
    for key, most in MOST.items():
        worst = max((report[key] for report in reports if report[key] is not None), default=math.nan)
        bars.hold(f"{key}, worst run", most, f"{worst:.4f}", not worst > most)
    lap_s = percentile([report["plate_time_s"] / laps for report in reports], 0.5)
    bars.hold("plate time of a lap, median, s", f"{LAP_S:.0f}", f"{lap_s:.1f}", lap_s <= LAP_S)
    speeds = list(map(speed_of, reports))
    bars.tell(f"times plate time, {at_once} at once, median", f"{percentile(speeds, 0.5):.1f}")
    bars.tell("  slowest", f"{min(speeds):.1f}")
    return bars


def main():
    args = parser_of(__doc__, seeds=50, laps=3, rig="upm-1", planner="auto", jobs=2).parse_args()
    job = config("plus-sign") | {"planner": args.planner, "rig": str(ROOT / f"configs/rigs/{args.rig}.json")}
    job["task"]["laps"] = args.laps
    job["limits"] = {"plate_time_s": 300.0 * args.laps}
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(args.jobs) as pool:
        path = pathlib.Path(folder) / "job.json"
        path.write_text(json.dumps(job))
        print(" seed outcome        laps  plate s   pulses    cross   at most   travel  sensing    times", flush=True)
        run = lambda seed: report_of(args.upm, path, folder, "--seed", seed, "--rerun", "off")
        reports = []
        for seed, report in enumerate(pool.map(run, range(1, args.seeds + 1)), 1):
            reports.append(report)
            print(line(seed, report), flush=True)
    print()
    judge(reports, args.laps, args.jobs).close()


if __name__ == "__main__":
    main()
