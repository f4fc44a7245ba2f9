"""The job templates of the named schedules, drawn by seed."""
import json
import math
from dataclasses import dataclass

from common import ROOT, config

RIGS = {name: config(f"rigs/{name}") for name in ("upm-1", "upm-2")}
RADIUS_MM = {"penny": 9.525, "nickel": 10.605, "dime": 8.955, "quarter": 12.13}
TOLERANCE_MM = 0.5
# farther than this from the edge, rims of parts
MARGIN_MM = 8.0


@dataclass(frozen=True)
class Made:
    """A job without faults, and its rig's name."""

    rig: str
    job: dict


def places(rng, rig, count, apart_mm, widest="penny", most_mm=math.inf):
    """Places at random, so far from each other, rims inside the edge."""
    reach_mm = min(RIGS[rig]["plate"]["side_mm"] / 2 - RADIUS_MM[widest] - MARGIN_MM, most_mm)
    found = []
    while len(found) < count:
        place = [round(rng.uniform(-reach_mm, reach_mm), 2) for _ in range(2)]
        if all(math.dist(place, other) >= apart_mm for other in found):
            found.append(place)
    return found


def arrange(rng, rig, count):
    """Pennies from random starts to random places."""
    task = {"type": "arrange", "targets_mm": places(rng, rig, count, 40.0)}
    return [{"kind": "penny", "count": count}], task


def swap(rng, rig):
    """A penny and a quarter exchange their places."""
    at = places(rng, rig, 2, 60.0, "quarter", 60.0)
    parts = [{"kind": kind, "position_mm": place} for kind, place in zip(("penny", "quarter"), at)]
    return parts, {"type": "arrange", "targets_mm": at[::-1], "assignment": "fixed"}


def equal(rng, rig):
    """Two equal pennies, each with a target of its own."""
    at = places(rng, rig, 4, 40.0, most_mm=90.0)
    parts = [{"kind": "penny", "position_mm": place} for place in at[:2]]
    return parts, {"type": "arrange", "targets_mm": at[2:], "assignment": "fixed"}


def sort8(_, __):
    job = config("sort-8")
    return job["parts"], job["task"]


def endless(_, __):
    return [{"kind": "penny"}], {"type": "plus_sign", "laps": 0, "edge_margin_mm": 8}


# name: maker, plate time limit by planner (fields, rotations), s
TEMPLATES = {
    "arr1": (lambda rng, rig: arrange(rng, rig, 1), (10, 40)),
    "arr4": (lambda rng, rig: arrange(rng, rig, 4), (20, 60)),
    "swap": (swap, (10, 40)),
    "equal": (equal, (10, 40)),
    "sort8": (sort8, (30, 90)),
    "endless": (endless, (10, 10)),
}


def small_camera(camera):
    """The same lens over a sensor of 640 x 512 with pixels twice as large."""
    half = dict(camera, size_px=[size // 2 for size in camera["size_px"]])
    half["focal_px"] = camera["focal_px"] / 2
    # pixel (0, 0) is the centre of the first one
    half["principal_px"] = [(at + 0.5) / 2 - 0.5 for at in camera["principal_px"]]
    return half


def rig_of(name, is_small):
    rig = json.loads(json.dumps(RIGS[name]))
    rig["library"] = str((ROOT / "configs/rigs" / rig["library"]).resolve())
    if is_small:
        rig["camera"] = small_camera(rig["camera"])
    return rig


def make(rng, template, rig, planner, seed=0, is_small=None):
    """A job; whether its camera is small is drawn where it is not told."""
    maker, limits_s = TEMPLATES[template]
    is_small = rng.random() < 0.8 if is_small is None else is_small
    parts, task = maker(rng, rig)
    job = {
        "name": f"{template}-{seed}",
        "seed": seed,
        "rig": rig_of(rig, is_small),
        "parts": parts,
        "task": task,
        "planner": planner,
        "tolerance_mm": TOLERANCE_MM,
        "limits": {"plate_time_s": limits_s[planner == "cor_sequence"]},
    }
    return Made(rig, job)
