#!/usr/bin/env python3
"""Check the report of a plus-sign run: completed, nothing lost, sensing and path errors within the project's bars.

usage: check_report.py REPORT.json...
"""
import json
import pathlib
import sys

from common import Bars, speed_of

MOST = {"lost_parts": 0, "sensing_rms_error_mm": 0.10, "cross_track_rms_mm": 0.20, "cross_track_max_mm": 0.6, "travel_ratio": 1.03}

bars = Bars()
for path in sys.argv[1:] or sys.exit(__doc__):
    report = json.loads(pathlib.Path(path).read_text())
    bars.hold(path, "completed", f"{report['outcome']}: {report['reason']}", report["outcome"] == "completed")
    bars.tell("times faster than plate time", f"{speed_of(report):.1f}")
    for key, most in MOST.items():
        bars.hold(key, most, report[key], report[key] is not None and report[key] <= most)
bars.close()
