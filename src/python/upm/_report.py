"""Reports of runs."""

import csv
import functools
import json
import os
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from upm._answer import answer


class Report:
    """How a run ended, from its folder `folder`.

    `document` is the run's `report.json`. `outcome` is "completed", "failed" or "cancelled", `reason` says why.
    `bool(report)` is true for a run that completed in truth, too.
    """

    def __init__(self, folder: str | os.PathLike[str], text: str | None = None) -> None:
        self.folder = Path(folder)
        self.document = json.loads(text or (self.folder / "report.json").read_text(encoding="utf-8"))

    @property
    def outcome(self) -> str:
        """Outcome of the run."""
        return self.document["outcome"]

    @property
    def reason(self) -> str:
        """Why it ended, in words."""
        return self.document["reason"]

    @property
    def plate_time_s(self) -> float:
        """Its length, s of plate time."""
        return self.document["plate_time_s"]

    def __bool__(self) -> bool:
        return self.outcome == "completed" and self.document.get("verdict") != "false_success"

    def __repr__(self):
        return f"Report({self.outcome}: {self.reason}; {self.plate_time_s:.2f} s, {str(self.folder)!r})"

    @functools.cached_property
    def tables(self) -> dict[str, dict[str, NDArray]]:
        """The tables of `upm export`, each a dict of columns: numpy arrays of floats, booleans or texts."""
        with tempfile.TemporaryDirectory(prefix="upm-") as folder:
            answer("export", self.folder, "--csv", "--to", folder)
            return {file.stem: _columns(file) for file in sorted(Path(folder).glob("*.csv"))}

    def frame(self, table: str):
        """A table as a data frame of pandas, or of polars where only that is installed."""
        columns = self.tables[table]
        try:
            import pandas as frames
        except ImportError:
            import polars as frames
        return frames.DataFrame(columns)


def _columns(file):
    with file.open(newline="", encoding="utf-8") as lines:
        names, *rows = csv.reader(lines)
    return {name: _array([row[i] for row in rows]) for i, name in enumerate(names)}


def _array(texts):
    if texts and set(texts) <= {"true", "false"}:
        return np.array([text == "true" for text in texts])
    try:
        return np.array([float(text) if text else np.nan for text in texts])
    except ValueError:
        return np.array(texts)
