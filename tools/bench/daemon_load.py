#!/usr/bin/env python3
"""A plus sign in real time beside event clients and requests: deadlines missed, and how long requests take.

usage: daemon_load.py [--minutes 10] [--watchers 64] [--rate 200] [--upm target/debug/upm]

One plate runs `configs/plus-sign.json` without end. 64 clients read its events, break off at times and resume. 200 requests
a second go to jobs, plates, health and metrics, one in ten a POST: jobs for another plate, which is paused, are submitted
and cancelled. Event clients are one process at niceness 10, requests another at niceness 5, each with one asyncio loop; a
request is measured from the first byte sent to the last one received, and both tell how late their own loop was. Probes tell
when the machine itself stood still, and which of the missed deadlines fall into that. Exit status 1 when a bar is missed.
"""
import sys
import time
from dataclasses import dataclass

from daemon_lib import Bars, Daemon, parser_of, percentile, plus_sign, say, work_folder, write_config
from daemon_traffic import Traffic
from machine_probe import FRAME_MS, MachineProbe

P99_BAR_MS = 10.0
LATE_BAR_FRAMES = 1
# between looks at the plate, s
LOOK_EVERY_S = 0.1
# what is counted at a look may have begun so long before the last one, s
LOOK_BACK_S = 0.1


def own_figures(daemon):
    """What the daemon itself says of requests and deadlines, where it is not nothing."""
    lines = daemon.ask("GET", "/metrics").body.decode().splitlines()
    wanted = ("upm_http_", "upm_deadline", "upm_event_streams")
    return [line for line in lines if line.startswith(wanted) and not line.endswith(" 0")]


@dataclass
class Miss:
    """Deadlines missed between two looks, `time.monotonic()`."""

    plate_s: float
    begin: float
    end: float
    count: int

    def stalled_ms(self, machine):
        """How long a core stood still about then."""
        stall = machine.longest_stall(self.begin, self.end)
        return stall.ms() if stall else 0.0

    def line(self, machine):
        stalled_ms = self.stalled_ms(machine)
        words = f"a core stood still for {stalled_ms:.1f} ms" if stalled_ms else "no core stood still"
        return f"at {self.plate_s:6.1f} s of plate time, {self.count}: {words}"


def watch_misses(daemon, job_id):
    """Looks at the plate until its first job has ended; when deadlines were missed."""
    misses, before, known, said = [], time.monotonic(), 0, 0.0
    while (plate := daemon.plate("upm-1"))["job"] == job_id:
        now = time.monotonic()
        if plate["deadline_misses"] > known:
            misses.append(Miss(plate["at_s"], before - LOOK_BACK_S, now, plate["deadline_misses"] - known))
            known = plate["deadline_misses"]
        if now - said >= 5.0:
            said = now
            say(f"  at {plate['at_s']:6.1f} s, {known} deadlines missed")
        before = now
        time.sleep(LOOK_EVERY_S)
    return misses


def blame(bars, misses, machine, plate_s):
    """Which misses are the machine's, and which may be the daemon's."""
    bars.tell("cores stood still for more than a frame", machine.words())
    bars.tell("time the host took from all cores, s", f"{machine.stolen_s:.2f}")
    own = sum(miss.count for miss in misses if miss.stalled_ms(machine) <= 0.5 * FRAME_MS)
    bars.tell("deadlines missed while no core stood still for half a frame", own)
    by_chance = sum(stall.ms() > 0.5 * FRAME_MS for stall in machine.stalls) * (LOOK_EVERY_S + LOOK_BACK_S) / plate_s
    bars.tell("share of looks that meet such a stall by chance", f"{100 * min(1.0, by_chance):.1f} %")


def main():
    parser = parser_of(__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--watchers", type=int, default=64)
    parser.add_argument("--rate", type=float, default=200.0, help="requests a second")
    args = parser.parse_args()
    plate_s = 60.0 * args.minutes
    with work_folder(args.keep) as folder:
        config = write_config(folder, {"upm-1": "upm-1", "held": "upm-2"}, default_plate="upm-1")
        with Daemon(args.upm, folder, config).start() as daemon:
            daemon.hold_plate("held")
            probe = MachineProbe()
            job = daemon.submit(plus_sign("upm-1", plate_time_s=plate_s))
            daemon.wait_moving(job["id"], 0.01)
            traffic = Traffic(daemon.address, "held", args.watchers, args.rate, args.seed, plate_s + 60.0)
            say(f"{plate_s:g} s of plate time beside {args.watchers} watchers and {args.rate:g} requests/s")
            misses = watch_misses(daemon, job["id"])
            machine = probe.finish()
            counts = traffic.finish()
            bars = judge(daemon.get(f"/v1/jobs/{job['id']}"), counts, plate_s)
            blame(bars, misses, machine, plate_s)
            figures = own_figures(daemon)
    print("\n".join(counts.lines()))
    print("\nthe daemon's own figures at the end:", *figures, sep="\n  ")
    print("\ndeadlines missed:", *(miss.line(machine) for miss in misses), sep="\n  ")
    print()
    sys.exit(bars.close())


def judge(job, counts, plate_s):
    bars, report = Bars(), job["report"] or {}
    ran_s = report.get("plate_time_s", 0.0)
    bars.hold("the job ran its time, s", f">= {plate_s:g}", f"{ran_s:g} ({job['state']}: {job['reason']})", ran_s >= plate_s)
    late = report.get("worst_late_frames")
    bars.hold("worst frames late", f"<= {LATE_BAR_FRAMES}", late, late is not None and late <= LATE_BAR_FRAMES)
    bars.tell("deadlines missed", report.get("deadline_misses"))
    found = counts.job_requests_ms()
    p99 = percentile(found, 0.99)
    bars.hold(f"p99 of {len(found)} job requests, ms", f"<= {P99_BAR_MS:g}", f"{p99:.2f}", p99 <= P99_BAR_MS)
    bars.hold("answers that should not be", "none", counts.unwanted() or "none", not counts.unwanted())
    bars.hold("connections and streams", "no fault", dict(counts.faults) or "no fault", not counts.faults)
    return bars


if __name__ == "__main__":
    main()
