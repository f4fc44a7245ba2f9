"""The vocabulary of faults: one fault as data, the classes that guards must notice, harmless sizes."""
import math
from dataclasses import dataclass

FOR_GOOD = math.inf
LIVENESS_END_S = 5.0


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
