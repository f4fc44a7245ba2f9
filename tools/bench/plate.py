#!/usr/bin/env python3
"""How fast the simulated plate is.

usage: plate.py [--upm target/debug/upm] [--repeats 5]

16 pennies on the dynamic plate of upm-2 through `upm simulate`, at full drive and at weaker ones: part-steps a second
of CPU time on one core, over the whole process, and with the time of the same run with one penny taken off, which leaves
what each further part costs. Best of the repeats. Exit status 1 when the bar of 2e7 part-steps a second is missed.
"""
import math
import pathlib
import sys

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))
from common import Bars, config, parser_of, simulate  # noqa: E402

SPEED_BAR = 2e7
PARTS, PULSES = 16, 120
# full: next to the generator's limit; faint: parts hardly slide, friction takes longest to solve
DRIVES_RADPS = {"full": 4.2, "weak": 0.3, "faint": 0.05}


def grid(parts):
    """Pennies 60 mm apart in rows of four."""
    return [{"kind": "penny", "position_mm": [60 * (i % 4) - 90, 60 * (i // 4) - 90]} for i in range(parts)]


def speed_experiment(parts, spin_radps):
    """Rotations to and fro about scattered centres."""
    rig, pulses = config("rigs/upm-2"), []
    rig.pop("library")
    for i in range(PULSES):
        centre = [80 * math.cos(2.4 * (i // 2)), 80 * math.sin(2.4 * (i // 2))]
        pulses.append({"cor_mm": centre, "omega_rad_s": spin_radps, "rotation": 1 - 2 * (i % 2), "sustain_s": 0.1})
    return {"rig": rig, "plate": "dynamic", "parts": grid(parts), "pulses": pulses, "sample_hz": 1}


def measure_speed(upm, drive, repeats, bars):
    many, one = (speed_experiment(parts, DRIVES_RADPS[drive]) for parts in (PARTS, 1))
    step_s, pulse = many["rig"]["simulation"]["step_s"], many["rig"]["drive"]
    steps = PULSES * (0.1 + 2 * pulse["attack_s"] + pulse["rest_s"]) / step_s
    # in turn, so that a slow spell of the machine meets both
    runs = [(simulate(upm, many), simulate(upm, one)) for _ in range(repeats)]
    ends_mm = [abs(part[axis][-1]) for part in runs[0][0][0]["parts"] for axis in ("x_mm", "y_mm")]
    if max(ends_mm) > 0.5 * many["rig"]["plate"]["side_mm"]:
        sys.exit("a part fell off the plate: the time says nothing")
    cpu_s, alone_s = (min(pair[i][1] for pair in runs) for i in (0, 1))
    speed, further = PARTS * steps / cpu_s, (PARTS - 1) * steps / (cpu_s - alone_s)
    bars.tell(f"{drive} drive, CPU s", f"{cpu_s:.3f}")
    told = f"{speed:.3g}, of further parts alone {further:.3g}"
    bars.hold("  part-steps/s, whole process", f"{SPEED_BAR:.0e}", told, speed >= SPEED_BAR)


def main():
    args, bars = parser_of(__doc__, repeats=5).parse_args(), Bars()
    for drive in DRIVES_RADPS:
        measure_speed(args.upm, drive, args.repeats, bars)
    bars.close()


if __name__ == "__main__":
    main()
