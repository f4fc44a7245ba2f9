#!/usr/bin/env python3
"""How fast the simulated plate is, and what its time step costs in accuracy.

usage: plate.py [--upm target/debug/upm] [--repeats 5] [--json]

(a) 16 pennies on the dynamic plate of upm-2 through `upm simulate`, at full drive and at weaker ones: part-steps a second
of CPU time on one core, over the whole process, and with the time of the same run with one penny taken off, which leaves
what each further part costs. Best of the repeats.
(b) Five pennies under twenty pulses on both kinds of plate: how far halving the step moves them, as a share of the way
they made. Exit status 1 when a bar is missed: 2e7 part-steps a second, 0.5 % of the way.
"""
import json
import math
import pathlib
import sys

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))
from common import Bars, config, parser_of, simulate  # noqa: E402

SPEED_BAR, SHIFT_BAR = 2e7, 0.005
PARTS, PULSES = 16, 120
HALVING_RADPS = 4.0
# full: next to the generator's limit; faint: parts hardly slide, friction takes longest to solve
DRIVES_RADPS = {"full": 4.2, "weak": 0.3, "faint": 0.05}


def rig(step_s=None):
    rig = config("rigs/upm-2")
    rig.pop("library")
    rig["simulation"]["step_s"] = step_s or rig["simulation"]["step_s"]
    return rig


def grid(parts):
    """Pennies 60 mm apart in rows of four."""
    return [{"kind": "penny", "position_mm": [60 * (i % 4) - 90, 60 * (i // 4) - 90]} for i in range(parts)]


def speed_experiment(parts, spin_radps):
    """Rotations to and fro about scattered centres."""
    pulses = []
    for i in range(PULSES):
        centre = [80 * math.cos(2.4 * (i // 2)), 80 * math.sin(2.4 * (i // 2))]
        pulses.append({"cor_mm": centre, "omega_rad_s": spin_radps, "rotation": 1 - 2 * (i % 2), "sustain_s": 0.1})
    return {"rig": rig(), "plate": "dynamic", "parts": grid(parts), "pulses": pulses, "sample_hz": 1}


def measure_speed(upm, drive, repeats):
    spin_radps = DRIVES_RADPS[drive]
    many, one = (speed_experiment(parts, spin_radps) for parts in (PARTS, 1))
    step_s, pulse = many["rig"]["simulation"]["step_s"], many["rig"]["drive"]
    plate_s = PULSES * (0.1 + 2 * pulse["attack_s"] + pulse["rest_s"])
    # in turn, so that a slow spell of the machine meets both
    runs = [(simulate(upm, many), simulate(upm, one)) for _ in range(repeats)]
    ends_mm = [abs(part[axis][-1]) for part in runs[0][0][0]["parts"] for axis in ("x_mm", "y_mm")]
    if max(ends_mm) > 0.5 * many["rig"]["plate"]["side_mm"]:
        sys.exit("a part fell off the plate: the time says nothing")
    cpu_s = min(pair[0][1] for pair in runs)
    alone_s = min(pair[1][1] for pair in runs)
    steps = plate_s / step_s
    return {
        "drive": drive,
        "cpu_s": cpu_s,
        "part_steps_per_s": PARTS * steps / cpu_s,
        "further_part_steps_per_s": (PARTS - 1) * steps / (cpu_s - alone_s),
    }


def halving_experiment(plate, step_s):
    places = [[90, 90], [-90, 75], [-75, -90], [90, -75], [0, 0]]
    pulses = []
    for i in range(20):
        centre = [60 * math.cos(2.4 * i), 60 * math.sin(2.4 * i)]
        pulses.append({"cor_mm": centre, "omega_rad_s": HALVING_RADPS, "rotation": 1 - 2 * (i % 2), "sustain_s": 0.02 + 0.003 * i})
    parts = [{"kind": "penny", "position_mm": place} for place in places]
    return {"rig": rig(step_s), "plate": plate, "parts": parts, "pulses": pulses, "sample_hz": 1000}


def ends_of_pulses(experiment, part):
    """Where `part` was before the first pulse and after each."""
    drive, at_s, marks = experiment["rig"]["drive"], 0.0, [0]
    for pulse in experiment["pulses"]:
        at_s += pulse["sustain_s"] + 2 * drive["attack_s"] + drive["rest_s"]
        marks.append(math.floor(at_s * experiment["sample_hz"] + 1e-6))
    return [complex(part["x_mm"][i], part["y_mm"][i]) for i in marks]


def measure_halving(upm, plate):
    step_s = rig()["simulation"]["step_s"]
    coarse, fine = (halving_experiment(plate, step) for step in (step_s, 0.5 * step_s))
    rows = []
    for a, b in zip(simulate(upm, coarse)[0]["parts"], simulate(upm, fine)[0]["parts"]):
        places, end = ends_of_pulses(fine, b), ends_of_pulses(coarse, a)[-1]
        way = sum(abs(to - fro) for fro, to in zip(places, places[1:]))
        rows.append({"way_mm": way, "shift_mm": abs(end - places[-1]), "share": abs(end - places[-1]) / way})
    return {"plate": plate, "step_s": step_s, "parts": rows, "worst_share": max(row["share"] for row in rows)}


def main():
    parser = parser_of(__doc__, repeats=5)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    speeds = [measure_speed(args.upm, drive, args.repeats) for drive in DRIVES_RADPS]
    halvings = [measure_halving(args.upm, plate) for plate in ("kinematic", "dynamic")]
    bars = Bars()
    for s in speeds:
        bars.tell(f"{s['drive']} drive, CPU s", f"{s['cpu_s']:.3f}")
        told = f"{s['part_steps_per_s']:.3g}, of further parts alone {s['further_part_steps_per_s']:.3g}"
        bars.hold("  part-steps/s, whole process", f"{SPEED_BAR:.0e}", told, s["part_steps_per_s"] >= SPEED_BAR)
    for h in halvings:
        shift = f"{100 * h['worst_share']:.4f} %"
        bars.hold(f"halving the step, {h['plate']}, of the way", f"{SHIFT_BAR:.1%}", shift, h["worst_share"] <= SHIFT_BAR)
    if args.json:
        print(json.dumps({"speed": speeds, "halving": halvings, "met": bars.are_held()}, indent=1))
        sys.exit(0 if bars.are_held() else 1)
    bars.close()


if __name__ == "__main__":
    main()
