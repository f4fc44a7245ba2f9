"""Libraries: what a rig was measured to do."""

import json
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from upm._answer import answer


class Library:
    """The COR library of a rig, from its file.

    For its n measured motions: `amplitudes` of the four coils in counts, shape (n, 4); the plate's `velocities_mmps`,
    shape (n, 2), and `spins_radps`, shape (n,); the centres of rotation `centers_mm`, shape (n, 2), infinite for
    translations. `document` is all of the file.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._take(json.loads(Path(path).read_text(encoding="utf-8")))

    @classmethod
    def _of_document(cls, text):
        made = cls.__new__(cls)
        made._take(json.loads(text))
        return made

    def _take(self, document):
        self.document = document
        entries = self.document["entries"]
        self.amplitudes = np.array([entry["amplitudes"] for entry in entries]).reshape(-1, 4)
        self.velocities_mmps = np.array([entry["velocity_mm_s"] for entry in entries]).reshape(-1, 2)
        self.spins_radps = np.array([entry["spin_rad_s"] for entry in entries])
        # a plate that turns by w about c moves by v = w x (r - c), so that c = (-v_y, v_x) / w
        with np.errstate(divide="ignore", invalid="ignore"):
            self.centers_mm = self.velocities_mmps[:, ::-1] * [-1, 1] / self.spins_radps[:, None]

    def range_mm(self, speed_mmps: NDArray | float) -> tuple[NDArray, NDArray]:
        """Shortest and longest distance of one pulse, mm, where the plate's speed has this amplitude."""
        grid = self.document["displacement"]
        speeds = np.append(0.0, grid["speed_mm_s"])
        return tuple(
            np.interp(speed_mmps, speeds, np.append(0.0, [row[column] for row in grid["distance_mm"]]))
            for column in (0, -1)
        )

    def __repr__(self):
        return f"Library of {self.document['rig']}, {len(self.spins_radps)} motions"


def calibrate(
    rig: str | os.PathLike[str], out: str | os.PathLike[str], *, seed: int = 1
) -> Library:
    """Measures what the rig in the file `rig` can do, as `upm calibrate` does; writes its library to `out` and returns
    it.
    """
    answer("calibrate", "--rig", rig, "--out", out, "--seed", seed)
    return Library(out)
