"""A planner of one's own in the real loop: matching pursuit over all rotations that the plate was measured to make."""

import numpy as np

import upm

PULSES, LONGEST_MM = 4, 6.0


def matching_pursuit(places_mm, targets_mm, library):
    """Pulse by pulse the rotation that brings all coins together nearest to their places."""
    steps, pulses = targets_mm - places_mm, []
    turned = np.stack([-places_mm[:, 1], places_mm[:, 0]], axis=1)
    flows = library.velocities_mmps[:, None] + library.spins_radps[:, None, None] * turned
    speeds = np.linalg.norm(flows, axis=2)
    least, most = library.range_mm(speeds)
    # a coin on a slow belt is carried less far than the fastest one by the same pulse
    fields = flows / speeds[:, :, None] * (most / most.max(1, keepdims=True))[:, :, None]
    for _ in range(PULSES):
        distances = (fields * steps).sum((1, 2)) / (fields**2).sum((1, 2))
        lengths = np.clip(np.abs(distances), least.max(1), np.minimum(most.max(1), LONGEST_MM))
        moved = fields * np.copysign(lengths, distances)[:, None, None]
        left = ((steps - moved) ** 2).sum((1, 2))
        best = left.argmin()
        if left[best] >= (steps**2).sum():
            break
        steps = steps - moved[best]
        pulses.append(upm.Rotation(best, np.copysign(lengths[best], distances[best])))
    return pulses


report = upm.run("arrange-2", planner=matching_pursuit, camera="positions", seed=1)
print(report)
