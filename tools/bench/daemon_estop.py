#!/usr/bin/env python3
"""Emergency stops under full load: plate time and wall time from the request to zero force.

usage: daemon_estop.py [--stops 10000] [--watchers 64] [--rate 200] [--upm target/debug/upm]

Three plates run a plus sign in real time beside the traffic of daemon_load.py. Each plate in turn: a job comes into motion, is
stopped at a random moment, the answer is checked, the plate is reset and resumed. Jobs that the watchdog ends first, since a
shared machine stood still, and stops that met a plate at rest are counted apart. Plate time and wall time of a stop are from
the daemon's answer, the client's time is from request to answer. Exit status 1 when a bar is missed.
"""
import asyncio
import json
import random
import time
from dataclasses import dataclass, field

from daemon_lib import hold_plate, options_of, plus_sign, say, serving
from daemon_traffic import Link, Traffic, judge_traffic
from common import Bars, percentile
from upm_daemon import DaemonFault

PLATES = ("upm-1", "upm-2", "upm-2-evening")
BAR_MS = 20.0
# plate time by which the first pulse of a job sounds, and the longest time after that until its stop, s
IN_MOTION_S, LONGEST_S = 0.05, 0.45
LOOK_EVERY_S = 0.015
STEP_S = 1e-3
# a run takes so long to end at most, s
TIMEOUT_S = 20.0
# jobs that wait for a plate
AHEAD = 3
# why a plate is paused after its watchdog ended a run
WATCHDOG = "the last job was stopped"


@dataclass
class Stops:
    """What the stops came to, ms."""

    plate_ms: list = field(default_factory=list)
    wall_ms: list = field(default_factory=list)
    client_ms: list = field(default_factory=list)
    at_rest: int = 0
    # jobs that ended before they were stopped: control came too late
    by_watchdog: int = 0
    wrong: dict = field(default_factory=dict)

    def made(self):
        return len(self.client_ms)

    def blame(self, why):
        self.wrong[why] = self.wrong.get(why, 0) + 1

    def take(self, answer):
        """Notes the answer of one stop."""
        self.client_ms.append(1e3 * answer.wall_s)
        if answer.status != 200:
            return self.blame(f"{answer.status} {answer.words()}")
        told = answer.json()
        if not told["persisted"]:
            self.blame("not on the disk in time")
        if not told["silent"] or told["requested_at_s"] is None or told["silent_at_s"] is None:
            return self.blame(f"not silent: {json.dumps(told)[:160]}")
        plate_s = told["silent_at_s"] - told["requested_at_s"]
        if plate_s == 0.0 and not told["wall_s"]:
            self.at_rest += 1
            return None
        self.plate_ms.append(1e3 * plate_s)
        self.wall_ms.append(1e3 * told["wall_s"])
        return None


class Campaign:
    """One loop over the plates' states, and one for each plate that stops it again and again."""

    def __init__(self, daemon, stops, seed):
        self.address, self.wanted, self.rng = daemon.address, stops, random.Random(seed)
        self.stops, self.begun, self.plates = Stops(), 0, {}
        self.seeds = iter(range(1, 10**9))

    async def run(self):
        looking = asyncio.create_task(self.look())
        telling = asyncio.create_task(self.tell())
        try:
            ends = await asyncio.gather(*(self.stop_again(plate) for plate in PLATES), return_exceptions=True)
        finally:
            looking.cancel()
            telling.cancel()
        for fault in filter(None, ends):
            self.stops.blame(f"a plate was given up: {fault!r}")
        return self.stops

    async def look(self):
        link = Link(self.address)
        while True:
            answer = await link.ask("GET", "/v1/plates")
            self.plates = {plate["name"]: plate for plate in answer.json()["plates"]} if answer.status == 200 else {}
            await asyncio.sleep(LOOK_EVERY_S)

    async def tell(self):
        while True:
            await asyncio.sleep(10.0)
            say(f"  {self.stops.made()} stops, {self.stops.at_rest} at rest, wrong: {self.stops.wrong or 'none'}")

    async def stop_again(self, name):
        link, last = Link(self.address), None
        while self.begun < self.wanted:
            self.begun += 1
            await self.fill(link, name)
            last = await self.until_moving(link, name, last)
            await asyncio.sleep(self.rng.uniform(0.0, LONGEST_S))
            answer = await link.ask("POST", f"/v1/plates/{name}/estop")
            self.stops.take(answer)
            await self.set_free(link, name, answer)

    async def fill(self, link, name):
        """Sees to it that jobs wait for the plate."""
        while name not in self.plates:
            await asyncio.sleep(LOOK_EVERY_S)
        for _ in range(AHEAD - self.plates[name]["queued"]):
            job = plus_sign(name, seed=next(self.seeds))
            answer = await link.ask("POST", "/v1/jobs", json.dumps(job).encode())
            if answer.status != 201:
                raise DaemonFault(f"submission: {answer.status} {answer.words()}")

    async def until_moving(self, link, name, last):
        """The job on the plate, another than the last, once it moves. What the watchdog stopped first is let go on."""
        until = time.monotonic() + TIMEOUT_S
        while time.monotonic() < until:
            plate = self.plates.get(name)
            if plate and plate["state"] == "running" and plate["job"] != last and plate["at_s"] >= IN_MOTION_S:
                return plate["job"]
            if plate and plate["state"] == "paused" and WATCHDOG in (plate["why"] or ""):
                self.stops.by_watchdog += 1
                await self.resume(link, name)
                await self.fill(link, name)
            await asyncio.sleep(LOOK_EVERY_S)
        raise DaemonFault(f"{name} does not move: {self.plates.get(name)}")

    async def set_free(self, link, name, answer):
        """Looks whether the plate stands, resets it as soon as its run has ended, and lets it go on."""
        found = (await link.ask("GET", "/v1/plates")).json()["plates"]
        plate = next(plate for plate in found if plate["name"] == name)
        silent_at_s = answer.json().get("silent_at_s") if answer.status == 200 else None
        if plate["state"] != "stopped":
            self.stops.blame(f"{plate['state']} after a stop")
        elif silent_at_s is not None and plate["at_s"] > silent_at_s + STEP_S:
            self.stops.blame("plate time went on after a stop")
        until = time.monotonic() + TIMEOUT_S
        body = json.dumps({"operator": "campaign", "reason": "the next stop"}).encode()
        while (answer := await link.ask("POST", f"/v1/plates/{name}/reset", body)).status != 200:
            if answer.status != 409 or time.monotonic() > until:
                raise DaemonFault(f"reset of {name}: {answer.status} {answer.words()}")
            await asyncio.sleep(LOOK_EVERY_S)
        await self.resume(link, name)

    async def resume(self, link, name):
        """Lets the plate go on, and waits until that is seen."""
        answer = await link.ask("POST", f"/v1/plates/{name}/resume")
        if answer.status != 200:
            raise DaemonFault(f"resume of {name}: {answer.status} {answer.words()}")
        self.plates[name] = answer.json()


def judge(stops, counts, wanted):
    bars = Bars()
    three = lambda found: ", ".join(f"{percentile(found, share):.3f}" for share in (0.5, 0.99, 1.0))
    bars.hold("stops", wanted, stops.made(), stops.made() >= wanted)
    bars.hold("answers and states that are wrong", "none", stops.wrong or "none", not stops.wrong)
    bars.tell("of these at rest: nothing to stop", stops.at_rest)
    bars.tell("jobs that the watchdog stopped before", stops.by_watchdog)
    worst = max(stops.plate_ms, default=float("nan"))
    bars.hold("request to zero force, ms of plate time, max", f"<= {BAR_MS:g}", f"{worst:.3f}", worst <= BAR_MS)
    bars.tell("  p50, p99, max", three(stops.plate_ms))
    bars.tell("the same on the wall, ms: p50, p99, max", three(stops.wall_ms))
    bars.tell("client, request to answer, ms: p50, p99, max", three(stops.client_ms))
    bars.tell("stops over 20 ms on the wall", sum(ms > BAR_MS for ms in stops.wall_ms))
    judge_traffic(bars, counts)
    return bars


def main():
    args = options_of(__doc__, stops=10_000, watchers=64, rate=200.0)
    with serving(args, {name: name for name in PLATES} | {"held": "upm-2"}, keep={"runs_gb": 1.0}) as daemon:
        hold_plate(daemon, "held")
        traffic, begin = Traffic(daemon.address, "held", args), time.monotonic()
        stops = asyncio.run(Campaign(daemon, args.stops, args.seed).run())
        took_s, counts = time.monotonic() - begin, traffic.finish()
    print("\n".join(counts.lines()), end="\n\n")
    bars = judge(stops, counts, args.stops)
    bars.tell("a stop, with all that belongs to it, s", f"{took_s / max(1, stops.made()):.2f}")
    bars.close()


if __name__ == "__main__":
    main()
