"""A caller's own planner and rig."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from upm._job import Job
from upm._upm import SimulatedPlate


@dataclasses.dataclass(frozen=True)
class Rotation:
    """A pulse about a measured centre of rotation.

    `entry` is its number in the library, `distance_mm` how far it carries the fastest part; negative runs it in reverse.
    """

    entry: int
    distance_mm: float

    def _for_native(self):
        return int(self.entry), float(self.distance_mm)


@dataclasses.dataclass(frozen=True)
class Motion:
    """A pulse of a synthesised motion.

    `coefficients`, of shape (harmonics, 2, 3), are those of cos and sin of each harmonic of the plate's velocity: along
    x and y in mm/s, and spin in rad/s. `sustain_s` is its time at full height.
    """

    coefficients: np.ndarray
    sustain_s: float

    def _for_native(self):
        return np.asarray(self.coefficients, float), float(self.sustain_s)


def planned_by(planner, library):
    """A planner for the compiled half, which passes on places and targets, mm."""
    return lambda places_mm, targets_mm: [pulse._for_native() for pulse in planner(places_mm, targets_mm, library)]


class Rig:
    """A plate with coils, accelerometers and camera. Derive from it, or have what it has.

    Attributes: `sample_hz`, samples a second of the coils; `accelerometer_hz`, `accelerometer_mps2_per_count` and
    `accelerometer_count_limit` of the accelerometers. Time passes in `capture` alone.
    """

    sample_hz: float
    accelerometer_hz: float
    accelerometer_mps2_per_count: float
    accelerometer_count_limit: int

    def now_s(self) -> float:
        """Plate time, s."""
        raise NotImplementedError

    def play(self, samples: NDArray[np.int16], driven_s: float, rest_s: float) -> None:
        """Starts to play `samples`, counts of the four coils, shape (n, 4), `int16`, and returns at once.

        They last `driven_s`; nothing else is played until `rest_s` after them.
        """
        raise NotImplementedError

    def capture(self) -> tuple[NDArray[np.uint8], int, float]:
        """Waits for the next exposure and returns its picture, shape (height, width), `uint8`; its number, which grows
        by one from exposure to exposure; and the time of the middle of the exposure, s.
        """
        raise NotImplementedError

    def trace(self) -> NDArray[np.int16]:
        """Counts of the four channels x1, y1, x2, y2 since the last pulse began, shape (n, 4), `int16`."""
        raise NotImplementedError

    def stop(self) -> None:
        """Silences the coils at once."""
        raise NotImplementedError


def simulated_plate(job: Job | str, *, seed: int | None = None) -> SimulatedPlate:
    """The simulated plate of a job with its parts at their start: it has what `Rig` has."""
    job = job if isinstance(job, Job) else Job(job)
    return SimulatedPlate(job._job if seed is None else job._job.with_seed(seed))
