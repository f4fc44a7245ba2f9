"""Randomly drawn jobs: any task, 2 to 30 parts of all kinds, dense and loose, both rigs and planners."""
import math
import random

from .jobs import RADIUS_MM, RIGS, Made, places, planners, rig_of

WIDEST_MM = max(RADIUS_MM.values())
# sixteen pennies as letters: many small steps over a long time
LETTERS_MM = [
    [-110, 50], [-110, 20], [-110, -10], [-85, -35], [-60, 50], [-60, 20], [-60, -10], [-20, 50],
    [-20, 20], [-20, -10], [-20, -40], [5, 50], [5, 5], [60, -40], [60, 0], [85, 10],
]  # fmt: skip


def letters(seed):
    """The letters with a seed of their own."""
    rng = random.Random(seed)
    planner = rng.choice(("moving_field", "synthesized_field"))
    task = {"type": "arrange", "targets_mm": LETTERS_MM, "assignment": "optimal"}
    job = {"name": f"letters-{seed}", "seed": seed, "rig": varied(rng, "upm-2", False), "parts": [{"kind": "penny", "count": 16}]}
    job |= {"planner": planner, "tolerance_mm": 0.5, "limits": {"plate_time_s": 300}, "task": task}
    return Made("letters", "upm-2", planner, job)


def varied(rng, name, is_small):
    """A rig with friction and a camera of its own."""
    rig = rig_of(name, is_small)
    rig["friction"]["spread"] = round(rng.uniform(0.0, 0.2), 3)
    rig["camera"]["read_noise"] = round(rig["camera"]["read_noise"] * rng.uniform(0.5, 2.0), 3)
    return rig


def half_side_mm(rig):
    """Largest coordinate of a target of any kind."""
    return RIGS[rig]["plate"]["side_mm"] / 2 - WIDEST_MM - 10.0


def mixed(rng, count):
    """Kinds in order, for as many parts."""
    kinds = rng.sample(sorted(RADIUS_MM), min(count, rng.randint(1, len(RADIUS_MM))))
    return [{"kind": kind, "count": count // len(kinds) + (i < count % len(kinds))} for i, kind in enumerate(kinds)]


def spread(rng, rig, count):
    """Places at random, loose or as near to each other as random places can be."""
    room_mm = 2 * half_side_mm(rig) / math.sqrt(count)
    return places(rng, rig, count, max(2.2 * WIDEST_MM, rng.uniform(0.4, 0.7) * room_mm), "quarter")


def grid(rng, rig, count):
    """Dense rows."""
    pitch_mm = rng.uniform(2.17, 2.6) * WIDEST_MM
    columns = min(math.ceil(math.sqrt(count)), int(2 * half_side_mm(rig) / pitch_mm) + 1)
    rows = math.ceil(count / columns)
    return [
        [round((i % columns - (columns - 1) / 2) * pitch_mm, 2), round((i // columns - (rows - 1) / 2) * pitch_mm, 2)]
        for i in range(count)
    ]


def ring(rng, rig, count):
    least_mm = 2.2 * WIDEST_MM / (2 * math.sin(math.pi / count))
    radius_mm = rng.uniform(least_mm, max(least_mm, half_side_mm(rig)))
    turns = [math.tau * i / count for i in range(count)]
    return [[round(radius_mm * math.cos(turn), 2), round(radius_mm * math.sin(turn), 2)] for turn in turns]


def arrange(rng, rig, count):
    fitting = [spread, grid] + [ring] * (2.2 * WIDEST_MM / (2 * math.sin(math.pi / count)) < half_side_mm(rig))
    assignment = rng.choice(("optimal", "fixed")) if count <= 12 else "optimal"
    return mixed(rng, count), {"type": "arrange", "targets_mm": rng.choice(fitting)(rng, rig, count), "assignment": assignment}


def sort(rng, rig, count):
    parts = mixed(rng, count)
    width_mm = 2 * half_side_mm(rig) / len(parts)
    left_mm = [-half_side_mm(rig) + i * width_mm for i in range(len(parts))]
    bins = [
        {"kinds": [row["kind"]], "region_mm": {"min": [round(x + 4, 1), -100], "max": [round(x + width_mm - 4, 1), 100]}}
        for x, row in zip(left_mm, parts)
    ]
    return parts, {"type": "sort", "bins": bins}


def paths(rng, rig, count):
    circle = {"circle": {"radius_mm": round(rng.uniform(0.5, 1.0) * half_side_mm(rig), 1)}, "count": min(count, 6)}
    paths = [{**circle, "speed_mm_s": rng.choice((6, 9, 12))}]
    return mixed(rng, 1)[:1] * circle["count"], {"type": "trajectories", "in_phase": True, "paths": paths}


def hold(rng, _, count):
    return mixed(rng, min(count, 12)), {"type": "hold", "duration_s": round(rng.uniform(5.0, 30.0), 1)}


def plus_sign(rng, _, __):
    return mixed(rng, 1), {"type": "plus_sign", "laps": 1, "edge_margin_mm": 10}


def make(rng, seed):
    """A job that a healthy rig completes."""
    rig = rng.choice(("upm-1", "upm-2", "upm-2"))
    planner = rng.choice(planners(rig, True))
    # rotations carry few parts in a time that a campaign has
    most = {"upm-1": rng.choice((1, 3)), "upm-2": 6 if planner == "cor_sequence" else 30}[rig]
    count = min(most, round(math.exp(rng.uniform(math.log(2), math.log(30)))))
    maker = rng.choice((plus_sign, hold) if count == 1 else (arrange, arrange, arrange, sort, paths, hold))
    parts, task = maker(rng, rig, count)
    if planner == "moving_field" and task["type"] == "hold":
        planner = "synthesized_field"
    described = varied(rng, rig, rng.random() < 0.5)
    job = {"name": f"{maker.__name__}-{seed}", "seed": seed, "rig": described, "parts": parts, "task": task}
    job |= {"planner": planner, "tolerance_mm": 0.5, "limits": {"plate_time_s": 150 + 20 * count}}
    return Made(maker.__name__, rig, planner, job)
