"""Jobs."""

import json
import os
from pathlib import Path
from typing import Any

from upm._shipped import shipped
from upm._upm import Job as _Job


class Job:
    """A job that was read and checked: parts, task and rig.

    `source` is a path, the name of a shipped job (`"arrange-8"`), or a mapping with the keys of a job file; keyword
    arguments are keys of a job file, too, and take the place of those in `source`. Files that a job names are looked
    for beside its file; a mapping's in `folder`, by default that of the shipped jobs, so that
    `"rig": "rigs/upm-2.json"` is at hand.

    Raises `UpmError` with every fault, one a line: file, JSON path, what is allowed, what was found.
    """

    def __init__(
        self,
        source: str | os.PathLike[str] | dict[str, Any] | None = None,
        *,
        folder: str | os.PathLike[str] | None = None,
        **keys: Any,
    ) -> None:
        name, text, beside = _read(source)
        if keys or not isinstance(text, str):
            document = json.loads(text) if isinstance(text, str) else dict(text)
            text = json.dumps({**document, **keys})
        self._job = _Job(text, os.fspath(folder or beside), name)

    @classmethod
    def _of(cls, job):
        made = cls.__new__(cls)
        made._job = job
        return made

    @property
    def name(self) -> str:
        """Name of the job."""
        return self._job.name

    @property
    def seed(self) -> int:
        """Seed of all random numbers."""
        return self._job.seed

    def to_dict(self) -> dict[str, Any]:
        """The job with its rig and all defaults written out."""
        return json.loads(self._job.effective())

    def __repr__(self):
        return f"Job({self.name!r}, seed={self.seed})"


def _read(source):
    """Name for refusals, text or mapping, and folder of a job."""
    configs = shipped() / "configs"
    if source is None or isinstance(source, dict):
        return "job", source or {}, configs
    path = Path(source)
    if not path.exists() and path.suffix == "" and (configs / f"{path}.json").exists():
        path = configs / f"{path}.json"
    return str(path), path.read_text(encoding="utf-8"), path.parent
