"""When the machine itself stands still: what no program on it can be blamed for.

One process per core, bound to it, sleeps a millisecond at a time with real-time priority (`SCHED_FIFO`), so that nothing which
is scheduled goes before it: it is late when the host of a virtual machine takes the core away, or the kernel does not let go
of it. Where real-time priority may not be had, lateness may be that of other programs, and `is_exact` is false.
"""
import contextlib
import multiprocessing
import os
import time
from dataclasses import dataclass

FRAME_MS = 1e3 / 60.0
NAP_S = 0.001
# a nap that is late by less is none to speak of, s
LATE_S = 0.004


@dataclass
class Stall:
    """A core stood still from `begin` to `end`, `time.monotonic()`."""

    core: int
    begin: float
    end: float

    def ms(self):
        return 1e3 * (self.end - self.begin)


@dataclass
class Machine:
    """How it stood with the machine over some time."""

    # in the order of their beginning
    stalls: list
    # time that the host of a virtual machine took from all cores, s
    stolen_s: float
    # false where other programs may be among the reasons
    is_exact: bool

    def words(self):
        """How often and how long cores stood still for more than a frame."""
        how = "" if self.is_exact else ", other programs among the reasons"
        long_ms = [stall.ms() for stall in self.stalls if stall.ms() > FRAME_MS]
        return f"{len(long_ms)} times, longest {max(long_ms, default=0.0):.1f} ms{how}"

    def longest_stall(self, begin, end):
        """The longest one that touches that time, or None."""
        return max((stall for stall in self.stalls if stall.begin < end and stall.end > begin), key=Stall.ms, default=None)


class MachineProbe:
    """Watches every core from its making until `finish`."""

    def __init__(self):
        self.stopping = multiprocessing.Event()
        self.is_exact, self.halves = True, []
        for core in sorted(os.sched_getaffinity(0)):
            here, there = multiprocessing.Pipe(duplex=False)
            child = multiprocessing.Process(target=watch, args=(core, self.stopping, there), daemon=True)
            child.start()
            self.is_exact &= here.recv()
            self.halves.append((here, child))
        self.stolen_from = stolen_s()

    def finish(self):
        """The machine, as it was."""
        taken_s = stolen_s() - self.stolen_from
        self.stopping.set()
        stalls = []
        for here, child in self.halves:
            stalls += here.recv()
            child.join()
        return Machine(sorted(stalls, key=lambda stall: stall.begin), taken_s, self.is_exact)


def watch(core, stopping, there):
    os.sched_setaffinity(0, {core})
    is_first = False
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        is_first = True
    there.send(is_first)
    stalls, before = [], time.monotonic()
    while not stopping.is_set():
        time.sleep(NAP_S)
        now = time.monotonic()
        if now - before > NAP_S + LATE_S:
            stalls.append(Stall(core, before + NAP_S, now))
        before = now
    there.send(stalls)


def stolen_s():
    """Time that the host of a virtual machine had taken from all cores, s; 0 where it is not counted."""
    with open("/proc/stat", encoding="ascii") as stat:
        fields = stat.readline().split()
    return int(fields[8]) / os.sysconf("SC_CLK_TCK") if len(fields) > 8 else 0.0

