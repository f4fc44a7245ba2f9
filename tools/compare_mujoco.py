#!/usr/bin/env python3
"""One shaken plate, four point parts, one pulse that moves each its own way: upm against MuJoCo.

usage: compare_mujoco.py [--upm target/debug/upm] [--venv target/compare-mujoco] [--seeds 1 2 3 4 5 7]

Each seed scatters four parts. A periodic plate motion is sought whose mean friction force points another way at each;
it is played as one pulse with `upm simulate` (prescribed plate motion) and with MuJoCo. MuJoCo, numpy and scipy are
installed from PyPI into the folder `--venv` when they are not there. Of seeds 1 to 10, MuJoCo finds 7 the hardest.

Displacements. upm at its default step of 50 µs is held against MuJoCo's own limit. MuJoCo runs at steps halved from
16 µs to 0.25 µs, its contacts stiffer the smaller the step, so that the limit is dry friction between hard bodies. If
the last two changes, over all parts, fall by a factor f > 1.3 the limit is the finest run + (its last change)/(f - 1),
Richardson's extrapolation with the order measured; else it is the finest run. What MuJoCo leaves uncertain is printed
beside: the last change or the distance from finest run to limit, whichever is larger. Errors are |d - reference| /
|reference| of the displacement vectors; the worst part counts.

Speed. The time of stepping one pulse, CPU time on one core, MuJoCo at 2 µs, best of three. For upm it is the time of
501 pulses less that of 1 pulse, over 500, both of whole processes: start and set-up cancel. For MuJoCo it is that of
the stepping loop less that of the same loop with calls that step nothing: set-up and Python are left out. Only this
ratio is judged. Another one is printed, MuJoCo's stepping against upm as a whole process, most of which is its start.

Exit status 1 when a bar is missed for any seed: errors of at most 5 %, at least 300 times MuJoCo's speed.
"""
import sys
import time

from common import ROOT, Bars, config, enter_venv, parser_of, simulate

PACKAGES = ["mujoco>=3.2", "numpy", "scipy"]
DISPLACEMENT_BAR, SPEED_BAR = 0.05, 300

FRICTION, MASS_KG, GRAVITY = 0.3, 2.5e-3, 9.80665
PARTS, REACH_M, APART_M = 4, 0.08, 0.05
BASE_HZ, HARMONICS, PEAK_MPS, LENGTH_M = 40.0, 6, 1.0, 0.1
ATTACK_S, SUSTAIN_S, REST_S = 0.01, 0.1, 0.06
DEFAULT_STEP_S = 5e-5
MUJOCO_STEPS_S, JUDGED_STEP_S = [1.6e-5, 8e-6, 4e-6, 2e-6, 1e-6, 5e-7, 2.5e-7], 2e-6
FALLING = 1.3
MORE_PULSES = 500


def basis(angles):
    """cos kθ and sin kθ, one row each, k = 1, 2, …"""
    multiples = np.arange(1, HARMONICS + 1)[:, None] * angles
    return np.concatenate([np.cos(multiples), np.sin(multiples)])


class Field:
    """Mean of u/|u| over a cycle at each part, u the plate's velocity there, as a function of the wave's amplitudes:
    those of vx, vy and ω·LENGTH_M after one another, of each all cosines before all sines."""

    def __init__(self, positions_m, samples=160):
        wave = basis(np.arange(samples) * 2 * np.pi / samples).T
        still = np.zeros_like(wave)
        rows = [
            [np.hstack([wave, still, -y * wave]), np.hstack([still, wave, x * wave])] for x, y in positions_m / LENGTH_M
        ]
        self.velocity_of = np.array(rows)

    def mean_and_slope(self, amplitudes, softness):
        velocity = self.velocity_of @ amplitudes
        speed = np.sqrt((velocity**2).sum(1, keepdims=True) + softness**2)
        unit, relative = velocity / speed, self.velocity_of / speed[..., None]
        along = np.einsum("pas,pask->psk", unit, relative)
        return unit.mean(2), (relative - unit[..., None] * along[:, None]).mean(2)


def synthesise(positions_m, wanted, rng, starts=24):
    """Amplitudes (3 × 2·HARMONICS; m/s, m/s, rad/s) whose mean force points as the unit vectors `wanted`, equally
    strong on all parts, out of `starts` random ones."""
    field, axes = Field(positions_m), 3
    order = np.tile(np.arange(1, HARMONICS + 1), 2 * axes)
    # Keeps amplitudes, the high ones most, no larger than they need be; pulls the force's strength up.
    weights, pull, strong, softness = 0.004 * np.sqrt(order), 0.1, 0.2, 0.03

    def miss(x):
        mean, _ = field.mean_and_slope(x[:-1], softness)
        return np.concatenate([(mean - x[-1] * wanted).ravel(), weights * x[:-1], [pull * (x[-1] - strong)]])

    def slope(x):
        _, by_amplitude = field.mean_and_slope(x[:-1], softness)
        force = np.hstack([by_amplitude.reshape(wanted.size, -1), -wanted.reshape(-1, 1)])
        return np.vstack([force, np.diag(np.append(weights, pull))])

    def score(amplitudes):
        mean, _ = field.mean_and_slope(amplitudes, 1e-9)
        strength = (mean * wanted).sum(1).mean()
        return strength - 5 * np.abs(mean - strength * wanted).max()

    tries = [np.append(rng.normal(size=order.size) / order, pull) for _ in range(starts)]
    found = [least_squares(miss, x, jac=slope, method="lm", max_nfev=100).x[:-1] for x in tries]
    best = max(found, key=score)
    rows = best.reshape(axes, -1)
    rows = rows * (PEAK_MPS / np.abs(rows @ basis(np.linspace(0, 2 * np.pi, 720))).max())
    rows[2] /= LENGTH_M
    return np.round(rows, 6)


def scatter(rng):
    """Random places, APART_M apart."""
    while True:
        places = np.round(rng.uniform(-REACH_M, REACH_M, (PARTS, 2)), 4)
        if min(np.linalg.norm(a - b) for i, a in enumerate(places) for b in places[:i]) > APART_M:
            return places


def experiment(positions_m, amplitudes, step_s, pulses):
    """The file for `upm simulate`: the pulse played to and fro."""
    rig = config("rigs/upm-2")
    rig["simulation"] = {"step_s": step_s}
    rig["kinds"] = {"point": {"diameter_mm": 0, "mass_g": 1e3 * MASS_KG, "thickness_mm": 1, "friction": FRICTION}}
    rig.pop("library")
    cos, sin = amplitudes[:, :HARMONICS].T, amplitudes[:, HARMONICS:].T
    harmonics = [{"cos": list(c), "sin": list(s)} for c, s in zip(cos, sin)]
    pulse = {"harmonics": harmonics, "attack_s": ATTACK_S, "sustain_s": SUSTAIN_S, "rest_s": REST_S}
    return {
        "rig": rig,
        "plate": "kinematic",
        "base_hz": BASE_HZ,
        "parts": [{"kind": "point", "position_mm": list(np.round(1e3 * p, 4))} for p in positions_m],
        "pulses": [{**pulse, "rotation": 1 - 2 * (i % 2)} for i in range(pulses)],
        "sample_hz": 100,
    }


def run_upm(upm, experiment):
    """Displacement of each part, m, as complex numbers, and CPU time of the process, s."""
    told, cpu_s = simulate(upm, experiment)
    ends = [[complex(p["x_mm"][i], p["y_mm"][i]) for p in told["parts"]] for i in (0, -1)]
    return 1e-3 * np.subtract(ends[1], ends[0]), cpu_s


def plate_velocities(amplitudes, step_s):
    """Velocity of the plate's centre and its spin in the middle of every step.

    upm's prescribed field stands still on the table; so that the plate's centre, at c, moves as that field does there,
    c' = v + iωc, whose solution is c = e^{iΘ} ∫ e^{-iΘ} v dt with Θ = ∫ ω dt."""
    t = np.arange(round((2 * ATTACK_S + SUSTAIN_S + REST_S) / step_s) + 1) * step_s
    edge = np.clip(np.minimum(t, 2 * ATTACK_S + SUSTAIN_S - t), 0, ATTACK_S)
    vx, vy, spin = (0.5 - 0.5 * np.cos(np.pi * edge / ATTACK_S)) * (amplitudes @ basis(2 * np.pi * BASE_HZ * t))

    def integral(values):
        return np.concatenate([[0], np.cumsum(0.5 * step_s * (values[1:] + values[:-1]))])

    velocity, turn = vx + 1j * vy, np.exp(1j * integral(spin))
    velocity = velocity + 1j * spin * turn * integral(velocity / turn)
    table = np.stack([velocity.real, velocity.imag, spin], 1)
    return 0.5 * (table[1:] + table[:-1])


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
        f"""<body pos="{x} {y} 0.001">{"".join(slides.values())}
          <geom name="ball {i}" type="sphere" size="0.001" mass="{MASS_KG}" {no_pairs}/></body>"""
        for i, (x, y) in enumerate(positions_m)
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


def run_mujoco(positions_m, amplitudes, step_s):
    """As `run_upm`, the time that of MuJoCo's steps alone."""
    model = mujoco.MjModel.from_xml_string(mujoco_model(positions_m, step_s))
    data = mujoco.MjData(model)
    velocities, plate, step = plate_velocities(amplitudes, step_s), data.qvel[:3], mujoco.mj_step

    begin = time.process_time()
    for velocity in velocities:
        plate[:] = velocity
        step(model, data, 0)
    between = time.process_time()
    for velocity in velocities:
        plate[:] = velocity
        step(model, data, 1)
    cpu_s = time.process_time() - between - (between - begin)
    moved = data.qpos[3:].reshape(PARTS, 3)
    return moved[:, 0] + 1j * moved[:, 1], cpu_s


def best(runs):
    """The quickest of runs that all come to the same displacement."""
    return min(runs, key=lambda run: run[1])


def limit_of(runs):
    """The displacements that runs at halved steps tend to, and the factor by which the last change fell."""
    last, before = runs[-1] - runs[-2], runs[-2] - runs[-3]
    fall = np.linalg.norm(before) / np.linalg.norm(last)
    return (runs[-1] + last / (fall - 1) if fall > FALLING else runs[-1]), fall


def errors(moved, reference):
    return np.abs(moved / reference - 1).tolist()


def time_upm(upm, places, wave):
    """Displacement in one pulse at the default step; CPU times a pulse, s: stepping alone, and of whole processes."""
    few, many = (experiment(places, wave, DEFAULT_STEP_S, pulses) for pulses in (1, 1 + MORE_PULSES))
    one, few_s = best([run_upm(upm, few) for _ in range(3)])
    drift, many_s = best([run_upm(upm, many) for _ in range(3)])
    ends_mm = 1e3 * (places + np.stack([drift.real, drift.imag], 1))
    if np.abs(ends_mm).max() > 0.5 * many["rig"]["plate"]["side_mm"]:
        sys.exit("a part fell off the plate in the long run: its time says nothing")
    return one, {
        "stepping": (many_s - few_s) / MORE_PULSES,
        "whole process": few_s,
    }


def compare(upm, seed):
    rng = np.random.default_rng(seed)
    places = scatter(rng)
    angles = rng.uniform(0, 2 * np.pi) + np.arange(PARTS) * 2 * np.pi / PARTS
    wave = synthesise(places, np.stack([np.cos(angles), np.sin(angles)], 1), rng)

    one, pulse_s = time_upm(upm, places, wave)
    repeats = {step_s: 3 if step_s >= JUDGED_STEP_S else 1 for step_s in MUJOCO_STEPS_S}
    theirs = {s: best([run_mujoco(places, wave, s) for _ in range(n)]) for s, n in repeats.items()}
    limit, fall = limit_of([moved for moved, _ in theirs.values()])
    previous, finest = (theirs[step_s][0] for step_s in MUJOCO_STEPS_S[-2:])
    uncertain = np.maximum(np.abs(finest - previous), np.abs(finest - limit)) / np.abs(limit)

    rows = {"upm 50 µs": errors(one, limit)}
    rows |= {f"MuJoCo {1e6 * s:g} µs": errors(moved, limit) for s, (moved, _) in theirs.items()}
    return {
        "seed": seed,
        "limit": limit,
        "change_falls_by": fall,
        "limit_uncertain": uncertain,
        "against_limit": rows,
        "upm_cpu_s": pulse_s,
        "mujoco_cpu_s": theirs[JUDGED_STEP_S][1],
    }


def times_faster(result, what="stepping"):
    return result["mujoco_cpu_s"] / result["upm_cpu_s"][what]


def judge(results):
    """Every bar with the worst part of the worst seed; speed is that of stepping, set-up left out."""
    bars = Bars()
    worst = max(max(result["against_limit"]["upm 50 µs"]) for result in results)
    bars.hold("upm 50 µs against MuJoCo's limit", f"{DISPLACEMENT_BAR} or less", f"{worst:.4g}", worst <= DISPLACEMENT_BAR)
    least = min(map(times_faster, results))
    bars.hold("stepping a pulse, MuJoCo 2 µs / upm", f"{SPEED_BAR} or more", f"{least:.0f}", least >= SPEED_BAR)
    return bars


def line(name, values, form="{:>20}"):
    print(f"  {name:46}" + "".join(form.format(value) for value in values))


def print_seed(result):
    limit = "extrapolated" if result["change_falls_by"] > FALLING else "its finest run"
    print(f"\nseed {result['seed']}; MuJoCo's limit {limit}, changes fall by {result['change_falls_by']:.2f} a halving")
    line("MuJoCo's limit", [f"{1e3 * abs(d):.3f} mm {np.degrees(np.angle(d)):6.1f}°" for d in result["limit"]])
    for name, row in result["against_limit"].items():
        line(f"error, {name}", row, "{:20.4f}")
    line("MuJoCo leaves uncertain", result["limit_uncertain"], "{:20.4f}")


def print_summary(results):
    print(f"\nMuJoCo {mujoco.__version__}; {BASE_HZ:.0f} Hz, {HARMONICS} harmonics, plate to {PEAK_MPS} m/s\n")
    line("", [f"seed {r['seed']}" for r in results], "{:>10}")
    for what in results[0]["upm_cpu_s"]:
        line(f"MuJoCo 2 µs / upm, {what}", [times_faster(r, what) for r in results], "{:10.0f}")
    print()


def main():
    args = parser_of(__doc__, venv=ROOT / "target/compare-mujoco", seeds=[1, 2, 3, 4, 5, 7]).parse_args()
    enter_venv(args.venv, PACKAGES)

    global mujoco, np, least_squares
    import mujoco
    import numpy as np
    from scipy.optimize import least_squares

    results = []
    for seed in args.seeds:
        results.append(compare(args.upm, seed))
        print_seed(results[-1])
    print_summary(results)
    judge(results).close()


if __name__ == "__main__":
    main()
