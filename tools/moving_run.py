#!/usr/bin/env python3
"""A run without pauses, integrated once more by other equations: journal in, places out.

usage: moving_run.py [--upm target/debug/upm] [--venv target/moving-run] [--seeds 1 2 3 4 5] [--step-us 25]

Each seed is a run of eight discs with a friction each. From the counts in its journal this file makes every sample of the coils
(docs/physics.md, sections 1.2 and 5.1), their low-pass, the plate on its rods, and the discs as 400 patches each under Coulomb's
law, in half upm's step, from the places at the start to those at the end. Exit status 1 when one is 0.5 mm off or more.
"""
import cmath
import json
import pathlib
import tempfile

from common import ROOT, Bars, config, enter_venv, parser_of, report_of

END_BAR_MM = 0.5
GRAVITY = 9.80665
PATCHES, SOFT_MPS, WHIRL = 400, 1e-4, cmath.exp(2.4j)


class Run:
    """A run folder: the rig as simulated, the plate as calibrated, and the drives that were sent."""

    def __init__(self, folder):
        folder = pathlib.Path(folder)
        self.job = json.loads((folder / "effective.json").read_text())["job"]
        self.report = json.loads((folder / "report.json").read_text())
        lines = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
        cycles = [line for line in lines if line["type"] == "cycle"]
        self.starts_m = np.array(cycles[0]["observed_mm"]) @ [1e-3, 1e-3j]
        self.ends_m = np.array([part["true_mm"] for part in self.report["parts"]]) @ [1e-3, 1e-3j]
        self.sent = [sent for cycle in cycles for sent in cycle["sent"]]
        self.motions = [pulse for cycle in cycles for pulse in cycle["plan"]["pulses"]]
        self.begins_s, self.ends_s = self.sent[0]["started_at_s"], self.report["plate_time_s"]

    def counts_at(self, t):
        """Whole counts of the four coils at each time, by the drive that plays and the one that decays below it."""
        counts, plate, motors = np.zeros((4, t.size)), self.job["library"]["plate"], self.job["rig"]["motors"]
        for sent, later in zip(self.sent, self.sent[1:] + [None]):
            start, attack, sustain = (sent[key] for key in ("started_at_s", "attack_s", "sustain_s"))
            if later and later["started_at_s"] < start + 2 * attack + sustain:
                sustain = max(0, later["started_at_s"] - start - attack)
            own = t - start
            sounds = (own > 0) & (own < 2 * attack + sustain)
            height, slope, bend = envelope(own[sounds], attack, sustain)
            x1, x2, y1, y2 = (cos - 1j * sin for cos, sin in np.moveaxis(np.array(sent["counts"]), 2, 1))
            s = 2j * np.pi * sent["base_hz"] * np.arange(1, x1.size + 1)
            turn = np.exp(np.outer(s, own[sounds]))
            played = []
            for axis, steady in {"x": x1 - x2, "y": y1 - y2, "spin": y1 + y2 - x1 - x2}.items():
                natural = 2 * np.pi * plate["natural_hz"][axis]
                damping = 2 * plate["damping_ratio"][axis] * natural
                inverse = steady / (s * s + damping * s + natural**2)
                parts = (height, steady), (slope, (2 * s + damping) * inverse), (bend, inverse)
                played.append(sum(factor * (phasors @ turn).real for factor, phasors in parts))
            x, y, spin = played[0] / 2, played[1] / 2, played[2] / 4
            counts[:, sounds] += [x - spin, -x - spin, y + spin, -y + spin]
        return np.clip(np.rint(counts), -motors["count_limit"], motors["count_limit"])

    def wrenches(self, step_s):
        """Forces and torque of the coils on the plate at the end of every step."""
        motors = self.job["rig"]["motors"]
        rate, corner = motors["sample_hz"], 2 * np.pi * motors["low_pass_hz"]
        middle = (np.arange(round((self.ends_s - self.begins_s) / step_s)) + 0.5) * step_s
        sample = np.floor(middle * rate).astype(int)
        held = self.counts_at(self.begins_s + np.arange(sample[-1] + 1) / rate)[:, sample].T
        keep, gain = stepped(corner, 0.5**0.5, step_s)
        passed, state = np.empty_like(held), np.zeros((2, 4))
        for i, counts in enumerate(held):
            state = keep @ state + np.outer(gain, corner**2 * counts)
            passed[i] = state[0]
        newtons = passed * motors["newtons_per_count"] * (1 + np.array(motors["gain_error"]))
        x1, x2, y1, y2 = np.clip(newtons, -motors["force_limit_n"], motors["force_limit_n"]).T
        return np.stack([x1 - x2, y1 - y2, 1e-3 * motors["lever_arm_mm"] * (y1 + y2 - x1 - x2)], 1)


class Plate:
    """The plate on its rods: displacement and rate of x, y and spin."""

    def __init__(self, run, step_s):
        plate = run.job["rig"]["plate"]
        inertias = {"x": plate["mass_kg"], "y": plate["mass_kg"], "spin": plate["inertia_kg_m2"]}
        natural, ratio = plate["resonance_hz"], plate["damping_ratio"]
        axes = [stepped(2 * np.pi * natural[axis], ratio[axis], step_s) for axis in inertias]
        self.keep = np.array([keep for keep, _ in axes])
        self.gain = np.array([gain / inertia for (_, gain), inertia in zip(axes, inertias.values())])
        self.state, self.wrench = np.zeros((3, 2)), np.zeros(3)

    def push(self, wrench):
        """Moves a step, over which forces and torque change to `wrench`; returns the mean of its ends."""
        moved = (self.keep @ self.state[:, :, None])[:, :, 0] + self.gain * ((self.wrench + wrench) / 2)[:, None]
        middle, self.state, self.wrench = (self.state + moved) / 2, moved, wrench
        return middle


def envelope(t, attack, sustain):
    """Height of a pulse, its slope and its curvature: two parabolas up, two down."""
    edge = np.minimum(t, 2 * attack + sustain - t) / attack
    low, rises = edge < 0.5, np.where(t < attack + sustain / 2, 1, -1)
    height = np.where(edge >= 1, 1, np.where(low, 2 * edge**2, 1 - 2 * (1 - edge) ** 2))
    slope = np.where(edge >= 1, 0, 4 * rises * np.minimum(edge, 1 - edge) / attack)
    return height, slope, np.where(edge >= 1, 0, np.where(low, 4, -4) / attack**2)


def stepped(natural, ratio, step_s):
    """q'' + 2 ratio natural q' + natural² q = u over a step of constant u: the matrix exponential, by its series."""
    whole = np.zeros((3, 3))
    whole[0, 1], whole[1] = 1, [-(natural**2), -2 * ratio * natural, 1]
    power = total = np.eye(3)
    for k in range(1, 25):
        power = power @ whole * (step_s / k)
        total = total + power
    return total[:2, :2], total[:2, 2]


def integrate(run, step_s):
    """Places of the discs at the end of the run, m."""
    discs = [run.job["rig"]["kinds"][part["kind"]] for part in run.job["parts"] for _ in range(part["count"])]
    radius, mass, pull = (np.array([disc[key] for disc in discs]) for key in ("diameter_mm", "mass_g", "friction"))
    radius, mass, pull = 5e-4 * radius, 1e-3 * mass, GRAVITY * pull
    i = np.arange(PATCHES)
    patches = radius[:, None] * np.sqrt((i + 0.5) / PATCHES) * np.exp(1j * np.pi * (3 - 5**0.5) * i)
    plate, friction = Plate(run, step_s), np.zeros(3)
    place, velocity, spin = run.starts_m, np.zeros(len(discs), complex), np.zeros(len(discs))
    for wrench in run.wrenches(step_s):
        # turned a little in every step: the sum over few patches is then as good as one over many
        patches = patches * WHIRL
        (x, vx), (y, vy), (_, turns) = plate.push(wrench + friction)
        arm = place - (x + 1j * y)
        slip = (velocity - (vx + 1j * vy) - 1j * turns * arm)[:, None] + 1j * (spin - turns)[:, None] * patches
        along = slip / np.sqrt(slip.real**2 + slip.imag**2 + SOFT_MPS**2)
        drag, twist = pull * along.mean(1), pull * (patches.conj() * along).imag.mean(1)
        velocity = velocity - step_s * drag
        spin = spin - step_s * 2 * twist / radius**2
        place = place + step_s * velocity
        force = (mass * drag).sum()
        friction = np.array([force.real, force.imag, (mass * ((arm.conj() * drag).imag + twist)).sum()])
    return place


def run_of(upm, name, seed, kinds, count):
    """A run in motion of a shipped job as upm makes it, without pixels, with `count` parts of each of these kinds."""
    rig, job = config("rigs/upm-2"), config(name)
    rig |= {"library": str(ROOT / "assets/libraries/upm-2.json"), "kinds": kinds, "friction": {"coefficient": 0.3}}
    parts = [{"kind": kind, "count": count} for kind in kinds]
    job |= {"seed": seed, "rig": rig, "planner": "moving_field", "parts": parts}
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "job.json"
        file.write_text(json.dumps(job))
        report_of(upm, file, folder, "--camera", "positions", "--rerun", "off")
        return Run(next(path for path in pathlib.Path(folder).iterdir() if path.is_dir()))


def discs(seed):
    """Eight kinds of sizes that the camera can tell apart, each with its own friction."""
    friction = np.round(0.3 * np.random.default_rng(seed).normal(1, 0.1, 8), 4)
    shape = {"mass_g": 2.5, "thickness_mm": 1.5}
    return {f"disc-{i}": shape | {"diameter_mm": round(17 * 1.035**i, 3), "friction": friction[i]} for i in range(8)}


def main():
    args = parser_of(__doc__, venv=ROOT / "target/moving-run", seeds=[1, 2, 3, 4, 5], step_us=25.0).parse_args()
    enter_venv(args.venv, ["numpy"])

    global np
    import numpy as np

    bars = Bars()
    for seed in args.seeds:
        run = run_of(args.upm, "arrange-8", seed, discs(seed), 1)
        apart_mm = 1e3 * np.abs(integrate(run, 1e-6 * args.step_us) - run.ends_m).max()
        way_mm, report = 1e3 * np.abs(run.ends_m - run.starts_m).mean(), run.report
        told = f"{report['outcome']} in {run.ends_s:.2f} s, {report['collisions']} touches, mean way {way_mm:.0f} mm"
        bars.tell(f"seed {seed}", told)
        bars.hold("  worst of 8 ends apart, mm", END_BAR_MM, f"{apart_mm:.3f}", apart_mm <= END_BAR_MM)
    bars.close()


if __name__ == "__main__":
    main()
