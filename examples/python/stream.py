"""A stream of goals: whenever a coin arrives, it gets a new place. Our planner moves eight coins on each of many plates.

usage: stream.py [GOALS]
"""

import sys

import gymnasium
import numpy as np

import upm.gym  # registers the environments


def main(goals, plates=16):
    """Counts arrivals, contacts between coins and coins that fall off, until so many goals were reached."""
    how = {"vectorization_mode": "vector_entry_point", "parts": 8, "action": "steps", "plate_time_s": 600}
    stream = gymnasium.make_vec("upm/Stream-v0", plates, **how)
    stream.reset(seed=1)
    reached = touches = lost = 0
    plate_time_s, last_s = 0.0, np.zeros(plates)
    while reached < goals:
        _, _, terminated, _, info = stream.step(stream.expert())
        reached += int(info["arrived"].sum())
        touches += int(info["collisions"].sum())
        lost += int(terminated.sum())
        plate_time_s += np.maximum(info["plate_time_s"] - last_s, 0).sum()
        last_s = info["plate_time_s"]
    rate = reached / plate_time_s
    print(f"{reached} goals within 0.5 mm, {touches} touches, {lost} coins lost; {rate:.2f} goals a second of plate time")
    print("completed")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 15000)
