"""A task that no job file has: coins form a ring that turns, until it has turned by a quarter."""

import numpy as np

import upm

RADIUS_MM, TURN_RADPS = 60, np.radians(6)


def turning_ring(at_s, places_mm):
    """Targets of all coins at a time, or None once the ring has turned far enough."""
    angle = TURN_RADPS * at_s
    if angle > np.pi / 2:
        return None
    around = angle + 2 * np.pi * np.arange(len(places_mm)) / len(places_mm)
    return RADIUS_MM * np.stack([np.cos(around), np.sin(around)], axis=1)


report = upm.run("arrange-4", task=turning_ring, camera="positions")
print(report)
