"""A universal planar manipulator: one shaken plate moves many coins, closed over a synthetic camera.

Lengths are in millimetres, times in seconds of plate time, as in job files. Every refusal is an `UpmError` with the
text that the command line would print.
"""

import importlib
import typing

if typing.TYPE_CHECKING:
    from upm._campaign import campaign
    from upm._job import Job
    from upm._library import Library, calibrate
    from upm._own import Motion, Rig, Rotation, simulated_plate
    from upm._picture import locate
    from upm._report import Report
    from upm._run import run
    from upm._shipped import shipped
    from upm._simulate import simulate
    from upm._upm import UpmError

_MODULES = {
    "Job": "_job",
    "Library": "_library",
    "Motion": "_own",
    "Report": "_report",
    "Rig": "_own",
    "Rotation": "_own",
    "UpmError": "_upm",
    "calibrate": "_library",
    "campaign": "_campaign",
    "locate": "_picture",
    "run": "_run",
    "shipped": "_shipped",
    "simulate": "_simulate",
    "simulated_plate": "_own",
}
__all__ = list(_MODULES)


def __getattr__(name):
    # the command does without numpy, whose threads would take its Ctrl-C
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"upm.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__():
    return __all__
