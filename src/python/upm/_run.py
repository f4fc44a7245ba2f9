"""Runs."""

import os
import types
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from typing import Any, Literal

from numpy.typing import NDArray

from upm._job import Job
from upm._library import Library
from upm._own import Motion, Rig, Rotation, planned_by
from upm._report import Report
from upm._upm import run as _run


def run(
    job: Job | str | os.PathLike[str] | dict[str, Any],
    *,
    seed: int | None = None,
    camera: Literal["pixels", "positions"] = "pixels",
    faults: Sequence[str] = (),
    out: str | os.PathLike[str] = "runs",
    task: Callable[[float, NDArray], NDArray | None] | None = None,
    planner: Callable[[NDArray, NDArray, Library], Sequence[Rotation | Motion]] | None = None,
    rig: Rig | None = None,
) -> Report:
    """Runs a job closed loop on its simulated rig, as `upm run` does, and returns its `Report`.

    `job` is a `Job` or what makes one. `camera="positions"` leaves out pixels: the parts' measured places take their
    stead, which is faster. `faults` are those of `upm run --faults`. The run folder is a new one in `out`.

    Three things can be the caller's own; an exception in one of them ends the run and is raised:

    - `task(at_s, places_mm)` returns the parts' targets, both of shape (n, 2), or `None` once it is done.
    - `planner(places_mm, targets_mm, library)` returns a list of `Rotation` and `Motion`, for parts at rest.
    - `rig` has the methods of `Rig`.

    Other Python threads go on meanwhile. Ctrl-C ends the run in good order, its folder whole, and raises
    `KeyboardInterrupt`.
    """
    job = job if isinstance(job, Job) else Job(job)
    if camera not in ("pixels", "positions"):
        raise ValueError(f"camera: expected pixels or positions, found {camera!r}")
    native = job._job.with_pixels(camera == "pixels")
    if seed is not None:
        native = native.with_seed(seed)
    if faults:
        native = native.with_faults([str(fault) for fault in faults])
    if planner is not None:
        planner = planned_by(planner, Library._of_document(native.library()))
    own = types.SimpleNamespace(task=task, planner=planner, rig=rig)
    folder, report = _run(native, os.fspath(out), datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ"), own)
    return Report(folder, report)
