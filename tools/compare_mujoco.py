#!/usr/bin/env python3
"""One shaken plate that never pauses, four point parts: upm against MuJoCo.

usage: compare_mujoco.py [--upm target/debug/upm] [--venv target/compare-mujoco] [--seeds 1 2 3 4 5 6]

Each seed is a run without pauses of arrange-4 with parts of 1 mm and 0.01 g, on which neither spin nor reaction shows.
From its journal `moving_run.py` makes the plate's velocity through all segments and cross-fades, from rest to rest;
MuJoCo moves a plate so under four points at the same starts.

Displacements. Where upm's parts ended is held against MuJoCo's own limit, dry friction between hard bodies: steps are halved
from 4 µs to 0.5 µs, contacts stiffer the smaller the step. If the last two changes, over all parts, fall by a factor f > 1.3
the limit is the finest run + (its last change)/(f - 1) (Richardson), else the finest run. Its uncertainty is printed, too: the
last change or the distance from finest run to limit, whichever is larger. Errors are |d - reference| / |reference|, worst part.

Speed. CPU time on one core of stepping a second of plate time, MuJoCo at 2 µs. For upm: 501 pulses in `upm simulate` (the run's
first motion to its sixth harmonic) less 1 pulse, over 500, best of three whole processes: set-up cancels. For MuJoCo: the
stepping loop of the whole run less the same loop with calls that step nothing.

Exit status 1 when a bar is missed for any seed: errors of at most 1 %, at least 300 times MuJoCo's speed.
"""
import sys
import time

import moving_run
from common import ROOT, Bars, config, enter_venv, parser_of, simulate, table

PACKAGES = ["mujoco>=3.2", "numpy"]
DISPLACEMENT_BAR, SPEED_BAR = 0.01, 300

FRICTION, MASS_KG, GRAVITY = 0.3, 2.5e-3, 9.80665
POINT = {"diameter_mm": 1, "mass_g": 0.01, "thickness_mm": 1, "friction": FRICTION}
PLATE_STEP_S = 2.5e-5
MUJOCO_STEPS_S, JUDGED_STEP_S = [4e-6, 2e-6, 1e-6, 5e-7], 2e-6
FALLING = 1.3
MORE_PULSES, PULSE_S, HARMONICS = 500, 0.2, 6


def experiment(run, pulses):
    """The file for `upm simulate`: the run's first motion, without the even harmonics, which would carry parts away."""
    rig, motion = config("rigs/upm-2"), run.motions[0]
    rig["kinds"] = {"point": POINT | {"diameter_mm": 0}}
    rig.pop("library")
    harmonics = [
        {} if k % 2 else {of: [1e-3 * v for v in h[f"{of}_mm_s"]] + [h[f"{of}_rad_s"]] for of in ("cos", "sin")}
        for k, h in enumerate(motion["harmonics"][:HARMONICS])
    ]
    pulse = {"harmonics": harmonics, "sustain_s": PULSE_S, "attack_s": 0, "rest_s": 0}
    return {
        "rig": rig,
        "plate": "kinematic",
        "base_hz": motion["base_hz"],
        "parts": [{"kind": "point", "position_mm": [1e3 * p.real, 1e3 * p.imag]} for p in 0.5 * run.starts_m],
        "pulses": [pulse] * pulses,
        "sample_hz": 100,
    }


def upm_cpu_s(upm, run):
    """CPU time of stepping a second of plate time."""
    one, many = ([simulate(upm, experiment(run, pulses)) for _ in range(3)] for pulses in (1, 1 + MORE_PULSES))
    if max(abs(part[axis][-1]) for part in many[0][0]["parts"] for axis in ("x_mm", "y_mm")) > 150:
        sys.exit("a part fell off the plate in the long run: its time says nothing")
    few_s, many_s = (min(cpu_s for _, cpu_s in runs) for runs in (one, many))
    return (many_s - few_s) / (MORE_PULSES * PULSE_S)


def mujoco_model(positions_m, step_s):
    """A plate that slides and spins; on it balls that slide and do not roll.

    Contacts are as stiff as the step allows, those of friction less so than those of the normal force. In MuJoCo's
    contact slip adds to the normal force, in proportion to friction's damping, and the parts hop. With one `solref` of
    0.5 ms for both they hop micrometres high, a millisecond without friction, and move erratically at any step; so, at
    2 µs, they hop fifty times lower. The plate is light, as the solver's tolerance goes by the mean inertia.
    """
    axes = [("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1")]
    slides = {name: f'<joint type="slide" axis="{axis}"/>' for name, axis in axes}
    no_pairs = 'contype="0" conaffinity="0"'
    balls = "".join(
        f"""<body pos="{p.real} {p.imag} 0.001">{"".join(slides.values())}
          <geom name="ball {i}" type="sphere" size="0.001" mass="{MASS_KG}" {no_pairs}/></body>"""
        for i, p in enumerate(positions_m)
    )
    contact = f"""condim="3" friction="{FRICTION} {FRICTION} 0 0 0" solimp="0.99 0.999 0.0001"
      solref="{5 * step_s} 1" solreffriction="{500 * step_s} 1" """
    pairs = "".join(f'<pair geom1="plate" geom2="ball {i}" {contact}/>' for i in range(len(positions_m)))
    return f"""<mujoco>
      <option timestep="{step_s}" cone="elliptic" gravity="0 0 -{GRAVITY}" tolerance="1e-14"/>
      <worldbody>
        <body pos="0 0 -0.005">{slides["x"]}{slides["y"]}<joint type="hinge" axis="0 0 1"/>
          <geom name="plate" type="box" size="0.3 0.3 0.005" mass="10" {no_pairs}/></body>
        {balls}
      </worldbody>
      <contact>{pairs}</contact></mujoco>"""


def run_mujoco(run, velocities, step_s):
    """Displacement of each part, m, as complex numbers, and CPU time of MuJoCo's steps alone, s."""
    middle = (np.arange(round(len(velocities) * PLATE_STEP_S / step_s)) + 0.5) * step_s
    known = (np.arange(len(velocities)) + 0.5) * PLATE_STEP_S
    velocities = np.stack([np.interp(middle, known, axis) for axis in velocities.T], 1)
    model = mujoco.MjModel.from_xml_string(mujoco_model(run.starts_m, step_s))
    data = mujoco.MjData(model)
    plate, step = data.qvel[:3], mujoco.mj_step

    begin = time.process_time()
    for velocity in velocities:
        plate[:] = velocity
        step(model, data, 0)
    between = time.process_time()
    for velocity in velocities:
        plate[:] = velocity
        step(model, data, 1)
    cpu_s = time.process_time() - between - (between - begin)
    moved = data.qpos[3:].reshape(-1, 3)
    return moved[:, 0] + 1j * moved[:, 1], cpu_s


def limit_of(runs):
    """The displacements that runs at halved steps tend to, and the factor by which the last change fell."""
    last, before = runs[-1] - runs[-2], runs[-2] - runs[-3]
    fall = np.linalg.norm(before) / np.linalg.norm(last)
    return (runs[-1] + last / (fall - 1) if fall > FALLING else runs[-1]), fall


def compare(upm, seed):
    run = moving_run.run_of(upm, "arrange-4", seed, {"point": POINT}, 4)
    plate = moving_run.Plate(run, PLATE_STEP_S)
    velocities = np.array([plate.push(wrench)[:, 1] for wrench in run.wrenches(PLATE_STEP_S)])
    theirs = {step_s: run_mujoco(run, velocities, step_s) for step_s in MUJOCO_STEPS_S}
    limit, fall = limit_of([moved for moved, _ in theirs.values()])
    finest, previous = (theirs[step_s][0] for step_s in (MUJOCO_STEPS_S[-1], MUJOCO_STEPS_S[-2]))
    moved = {"upm": run.ends_m - run.starts_m} | {f"MuJoCo {1e6 * s:g} µs": moved for s, (moved, _) in theirs.items()}
    return {
        "seed": seed,
        "segments": len(run.sent),
        "limit": limit,
        "change_falls_by": fall,
        "limit_uncertain": np.maximum(np.abs(finest - previous), np.abs(finest - limit)) / np.abs(limit),
        "against_limit": {name: np.abs(moved / limit - 1) for name, moved in moved.items()},
        "times_faster": theirs[JUDGED_STEP_S][1] / (len(velocities) * PLATE_STEP_S) / upm_cpu_s(upm, run),
    }


def judge(results):
    """Every bar with the worst part of the worst seed; speed is that of stepping, set-up left out."""
    bars = Bars()
    worst = max(result["against_limit"]["upm"].max() for result in results)
    bars.hold("upm against MuJoCo's limit", f"{DISPLACEMENT_BAR} or less", f"{worst:.4g}", worst <= DISPLACEMENT_BAR)
    bars.tell("MuJoCo leaves uncertain", f"{max(result['limit_uncertain'].max() for result in results):.4g}")
    least = min(result["times_faster"] for result in results)
    bars.hold("stepping, MuJoCo 2 µs / upm", f"{SPEED_BAR} or more", f"{least:.0f}", least >= SPEED_BAR)
    return bars


def print_seed(result):
    limit = "extrapolated" if result["change_falls_by"] > FALLING else "its finest run"
    print(f"\nseed {result['seed']}, {result['segments']} segments, stepping {result['times_faster']:.0f} times faster")
    print(f"  MuJoCo's limit {limit}, changes fall by {result['change_falls_by']:.2f} a halving")
    limits = [f"{1e3 * abs(d):.3f} mm {np.degrees(np.angle(d)):6.1f}°" for d in result["limit"]]
    errors = {f"error, {name}": row for name, row in result["against_limit"].items()}
    errors["MuJoCo leaves uncertain"] = result["limit_uncertain"]
    rows = [[name, *(f"{error:.4f}" for error in row)] for name, row in errors.items()]
    print("\n".join(f"  {row}" for row in table(["MuJoCo's limit", *limits], rows)), flush=True)


def main():
    args = parser_of(__doc__, venv=ROOT / "target/compare-mujoco", seeds=[1, 2, 3, 4, 5, 6]).parse_args()
    enter_venv(args.venv, PACKAGES)

    global mujoco, np
    import mujoco
    import numpy as np

    moving_run.np = np
    results = []
    for seed in args.seeds:
        results.append(compare(args.upm, seed))
        print_seed(results[-1])
    print(f"\nMuJoCo {mujoco.__version__}\n")
    judge(results).close()


if __name__ == "__main__":
    main()
