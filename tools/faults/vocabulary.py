"""The vocabulary of faults: one fault as data, its sizes in a draw, the classes that guards must notice, harmless sizes."""
import math
from dataclasses import dataclass

FOR_GOOD = math.inf
ONSET_S, LENGTH_S = (0.01, 20.0), (0.02, 20.0)
LIVENESS_END_S = 5.0
# planning takes no plate time: a pulse starts 1 ms after the frame it was planned from, the first one at 34.35 ms
PLAN_ONSET_S, PLAN_SHARE = 0.034, 0.03
# where it is known when a job ends, faults that begin shortly before
LAST_S, LAST_SHARE = (0.04, 0.3), 0.25


@dataclass(frozen=True)
class Fault:
    """One fault: where, what, how much, from when to when."""

    component: str
    kind: str
    value: tuple = ()
    from_s: float = 0.0
    to_s: float = FOR_GOOD

    @classmethod
    def of(cls, row):
        """From a row of `faults` in a job, an `effective.json` or a report."""
        value = row.get("value")
        value = tuple(value) if isinstance(value, list) else () if value is None else (value,)
        to_s = row.get("to_s")
        return cls(row["component"], row["kind"], value, row.get("from_s") or 0.0, FOR_GOOD if to_s is None else to_s)

    @classmethod
    def parse(cls, text):
        """From `COMPONENT:KIND[=V1;V2][@FROM[-TO]]`."""
        what, _, when = text.partition("@")
        component, _, kind = what.partition(":")
        kind, _, value = kind.partition("=")
        begin, _, end = when.partition("-")
        values = tuple(float(v) for v in value.split(";")) if value else ()
        return cls(component, kind, values, float(begin or 0), float(end) if end else FOR_GOOD)

    def row(self):
        """As a job file has it."""
        row = {"component": self.component, "kind": self.kind, "from_s": self.from_s}
        if self.value:
            row["value"] = list(self.value) if len(self.value) > 1 else self.value[0]
        if self.to_s != FOR_GOOD:
            row["to_s"] = self.to_s
        return row

    def __str__(self):
        value = f"={';'.join(f'{v:g}' for v in self.value)}" if self.value else ""
        end = "" if self.to_s == FOR_GOOD else f"-{self.to_s:g}"
        return f"{self.component}:{self.kind}{value}@{self.from_s:g}{end}"

    @property
    def group(self):
        """The component without its number."""
        return self.component.rstrip("0123456789")

    @property
    def name(self):
        """`coil dead`: what tables call it."""
        return f"{self.group} {self.kind}"

    def holds(self, at_s):
        return self.from_s <= at_s < self.to_s


def as_text(faults):
    """The value of `--faults`."""
    return ",".join(str(fault) for fault in faults)


def is_blinding(fault):
    """True for a fault that hides the plate from the camera, or may."""
    small = fault.name == "camera drop" and fault.value[0] <= 0.5
    dim = fault.name in ("light gain", "camera exposure") and not 0.3 <= fault.value[0] <= 1.5
    return dim or not small and fault.name in ("camera dark", "camera garbage", "camera drop", "view hand")


def harmless(fault):
    """True for a fault that a run has to get over; the one table of what is harmless."""
    size = max((abs(v) for v in fault.value), default=0.0)
    length_s = fault.to_s - fault.from_s
    if fault.group == "accel":
        return True
    return {
        "camera drop": size <= 0.5,
        "camera dark": length_s <= 0.5,
        "camera garbage": length_s <= 0.5,
        "camera late": size <= 1,
        "camera shift": size <= 0.3,
        "light gain": 0.5 <= size <= 1.1,
        "camera exposure": 0.5 <= size <= 1.1,
        "light flicker": True,
        "view hand": length_s <= 2.0,
        "coil gain": 0.95 <= size <= 1.05 and fault.value[0] > 0,
        "coils gain": 0.95 <= size <= 1.05 and fault.value[0] > 0,
        "part friction": 0.5 <= size <= 2.0,
        "part moved": size <= 5.0,
        "plate bumped": size <= 1.0,
        "device hang": True,
        "device deaf": True,
    }.get(fault.name, False)


def log_uniform(rng, least, most):
    return math.exp(rng.uniform(math.log(least), math.log(most)))


def signed(rng, least, most):
    return rng.choice((-1, 1)) * log_uniform(rng, least, most)


def pair(rng, count):
    return tuple(float(i) for i in rng.sample(range(count), 2))


def one(draw):
    return lambda rng: (draw(rng),)


def two(least, most):
    return lambda rng: (signed(rng, least, most), signed(rng, least, most))


def nothing(_):
    return ()


def factor(least, most):
    return one(lambda rng: log_uniform(rng, least, most))


CAMERA = {
    "freeze": nothing,
    "late": one(lambda rng: float(round(log_uniform(rng, 1, 30)))),
    "drop": factor(0.01, 1.0),
    "dark": nothing,
    "garbage": nothing,
    "shift": two(0.2, 120.0),
    "rotate": one(lambda rng: signed(rng, 0.05, 20.0)),
    "mirror": nothing,
}
COIL = {
    "dead": nothing,
    "gain": factor(0.5, 2.0),
    "reversed": nothing,
    "stuck": nothing,
    "low_pass": factor(20.0, 500.0),
    "chatter": factor(0.01, 1.0),
}
ACCEL = {
    "dead": nothing,
    "stuck": nothing,
    "garbage": nothing,
    "flip": nothing,
    "gain": factor(0.5, 2.0),
    "late": CAMERA["late"],
    "clipped": factor(1.0, 40.0),
}
PART = {"moved": two(0.5, 30.0), "removed": nothing, "glued": nothing, "ice": nothing, "friction": factor(0.2, 5.0)}
PLATE = {
    "bumped": two(0.2, 10.0),
    "tilt": one(lambda rng: signed(rng, 0.1, 5.0)),
    "resonance": factor(0.5, 2.0),
    "oil": lambda rng: (*two(5.0, 90.0)(rng), log_uniform(rng, 5.0, 50.0)),
}
OTHER = {
    "light": {"gain": factor(0.05, 2.0), "flicker": factor(0.5, 120.0)},
    "view": {"hand": factor(0.02, 0.6), "ghost": two(5.0, 90.0)},
    "device": {"busy": nothing, "error": nothing, "hang": factor(0.02, 0.5), "deaf": nothing},
    "clock": {"skew": one(lambda rng: signed(rng, 0.005, 0.5))},
}


def vocabulary(parts):
    """Every (component, kind, draw of its values) of a rig with so many parts."""
    table = {"camera": CAMERA, "coils": COIL | {"swapped": lambda rng: pair(rng, 4)}, "plate": PLATE} | OTHER
    table |= {f"coil{i}": COIL for i in range(4)} | {f"accel{i}": ACCEL for i in range(4)}
    table |= {f"part{i}": PART for i in range(parts)}
    if parts > 1:
        table["parts"] = {"swapped": lambda rng: pair(rng, parts)}
    return [(component, kind, draw) for component, kinds in table.items() for kind, draw in kinds.items()]


def drawn(rng, parts, is_liveness, job_end_s=None):
    """A schedule: a fifth of all draws has none, the others one to five kinds out of a random half of the vocabulary."""
    if rng.random() < 0.2:
        return []
    by_name = {}
    for component, kind, draw in vocabulary(parts):
        by_name.setdefault(f"{component.rstrip('0123456789')} {kind}", []).append((component, kind, draw))
    swarm = rng.sample(sorted(by_name), len(by_name) // 2)
    faults = []
    for name in rng.sample(swarm, rng.randint(1, 5)):
        component, kind, draw = rng.choice(by_name[name])
        begin_s = PLAN_ONSET_S if rng.random() < PLAN_SHARE else log_uniform(rng, *ONSET_S)
        if job_end_s and rng.random() < LAST_SHARE:
            begin_s = job_end_s - rng.uniform(*LAST_S)
        end_s = begin_s + log_uniform(rng, *LENGTH_S) if rng.random() < 0.5 else FOR_GOOD
        if is_liveness:
            begin_s, end_s = min(begin_s, LIVENESS_END_S - 0.1), min(end_s, LIVENESS_END_S)
        value = tuple(round(v, 3) for v in draw(rng))
        if (component, kind) == ("light", "gain") and round(value[0] * 1000) % 2:
            # half of them without a draw of their own, so that the other faults of a seed stay what they were
            component, kind = "camera", "exposure"
        faults.append(Fault(component, kind, value, round(begin_s, 3), FOR_GOOD if end_s == FOR_GOOD else round(end_s, 3)))
    return faults
