#!/usr/bin/env python3
"""Check the report of a plus-sign run: completed, nothing lost, sensing and path errors within the project's bars.

usage: check_report.py REPORT.json...
"""
import json
import sys

BARS = {"sensing_rms_error_mm": 0.10, "cross_track_rms_mm": 0.20, "cross_track_max_mm": 0.6, "travel_ratio": 1.03}


def faults(report):
    if report["outcome"] != "completed":
        yield f"outcome is {report['outcome']}: {report['reason']}"
    if report["lost_parts"]:
        yield f"{report['lost_parts']} parts lost"
    for key, bar in BARS.items():
        if not report[key] <= bar:
            yield f"{key} is {report[key]}, at most {bar} is allowed"
    speed = report["plate_time_s"] / report["wall_time_s"]
    print(f"{report['plate_time_s']:.1f} s of plate time in {report['wall_time_s']:.1f} s: {speed:.1f} times faster")


bad = 0
for path in sys.argv[1:] or sys.exit(__doc__):
    with open(path) as file:
        report = json.load(file)
    for fault in faults(report):
        print(f"{path}: {fault}")
        bad += 1
print("report ok" if not bad else f"{bad} faults")
sys.exit(1 if bad else 0)
