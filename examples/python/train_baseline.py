"""A baseline that learns: evolution strategies find the motions that push one coin where it should go, with numpy alone.

usage: train_baseline.py [GENERATIONS]

The policy is linear and knows no physics: the motion's coefficients are a matrix times the way to the target. Then it
is compared with our planner and with chance, on the same plates.
"""

import sys

import gymnasium
import numpy as np

import upm.gym  # registers the environments

PLATES, SPREAD, RATE, STEPS = 64, 0.1, 0.3, 3


def made(number, **how):
    kind = {"vectorization_mode": "vector_entry_point", "parts": 1, "action": "motion", "plate_time_s": 20, **how}
    return gymnasium.make_vec("upm/Arrange-v0", number, **kind)


def actions_of(policies, seen):
    """Actions of one policy, shape (actions, 2), for each plate; those nearer than 2 cm are pushed less."""
    way = seen[:, 2:4] - seen[:, 0:2]
    length = np.linalg.norm(way, axis=1, keepdims=True)
    way = way / np.maximum(length, 0.13)
    return np.clip(np.einsum("nak,nk->na", policies, way), -1, 1)


def success(plates, act, seed=1000):
    """Share of plates whose coin comes within 0.5 mm of its place, share within 65 % of its diameter, median of the nearest
    distances, mm."""
    seen, _ = plates.reset(seed=seed)
    home, nearest = np.zeros(plates.num_envs, bool), np.full(plates.num_envs, np.inf)
    open_still = ~home
    while open_still.any():
        seen, _, terminated, truncated, info = plates.step(act(seen))
        nearest = np.where(open_still, np.minimum(nearest, info["mean_distance_mm"]), nearest)
        home |= open_still & info["is_success"]
        open_still &= ~(terminated | truncated)
    return home.mean(), (nearest < 0.65 * 19.05).mean(), np.median(nearest)


def train(generations, random):
    plates = made(PLATES, plate_time_s=1e4)
    size = plates.single_action_space.shape[0]
    policy, velocity = random.normal(0, 0.05, (size, 2)), np.zeros((size, 2))
    for generation in range(generations):
        noise = random.normal(size=(PLATES // 2, size, 2))
        noise = np.concatenate([noise, -noise])
        seen, _ = plates.reset(seed=generation * PLATES)
        gained = np.zeros(PLATES)
        for _ in range(STEPS):
            seen, rewards, *_ = plates.step(actions_of(policy + SPREAD * noise, seen))
            gained += rewards
        ranks = gained.argsort().argsort() / (PLATES - 1) - 0.5
        velocity = 0.8 * velocity + np.einsum("n,nak->ak", ranks, noise) / PLATES
        policy = policy + RATE * velocity
        if generation % 50 == 0:
            print(f"generation {generation:4}: {1e3 * gained.mean():+.1f} thousandths of a plate a plate")
    return policy


def main(generations):
    random = np.random.default_rng(1)
    policy = train(generations, random)
    plates = made(32)
    act = {
        "learnt": lambda seen: actions_of(np.broadcast_to(policy, (32, *policy.shape)), seen),
        "our planner": lambda seen: plates.expert(),
        "chance": lambda seen: random.uniform(-1, 1, plates.action_space.shape),
    }
    for name, of in act.items():
        exact, rough, nearest_mm = success(plates, of)
        print(f"{name:12} {exact:5.0%} within 0.5 mm, {rough:5.0%} within 12.4 mm, {nearest_mm:6.2f} mm in the median")
    print("completed")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 150)
