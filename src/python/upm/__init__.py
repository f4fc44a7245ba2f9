"""A universal planar manipulator: one shaken plate moves many coins, closed over a synthetic camera.

Lengths are in millimetres, times in seconds of plate time, as in job files. Every refusal is an `UpmError` with the
text that the command line would print.
"""

from upm._job import Job
from upm._library import Library, calibrate
from upm._own import Motion, Rig, Rotation, simulated_plate
from upm._picture import locate
from upm._report import Report
from upm._run import run
from upm._shipped import shipped
from upm._simulate import simulate
from upm._upm import UpmError

__all__ = [
    "Job",
    "Library",
    "Motion",
    "Report",
    "Rig",
    "Rotation",
    "UpmError",
    "calibrate",
    "locate",
    "run",
    "shipped",
    "simulate",
    "simulated_plate",
]
