#!/usr/bin/env python3
"""A plus sign in real time beside event clients and requests: deadlines missed, and how long requests take.

usage: daemon_load.py [--minutes 10] [--watchers 64] [--rate 200] [--upm target/debug/upm]

One plate runs `configs/plus-sign.json` without end. 64 clients read its events, break off at times and resume. 200 requests
a second go to jobs, plates, health and metrics, one in ten a POST: jobs for a paused plate are submitted and cancelled. A
request is measured from the first byte sent to the last one received. Says how much time the host of a virtual machine took
from the cores: frames are late then, too. Exit status 1 when a bar is missed.
"""
from daemon_lib import hold_plate, options_of, plus_sign, say, serving, stolen_s
from daemon_traffic import Traffic, judge_traffic
from common import Bars, percentile

P99_BAR_MS, LATE_BAR_FRAMES = 10.0, 1


def main():
    args = options_of(__doc__, minutes=10.0, watchers=64, rate=200.0)
    plate_s = 60.0 * args.minutes
    with serving(args, {"upm-1": "upm-1", "held": "upm-2"}, default_plate="upm-1") as daemon:
        hold_plate(daemon, "held")
        job = daemon.submit(plus_sign("upm-1", plate_time_s=plate_s))
        daemon.wait_for("the job on its plate", lambda: daemon.plate("upm-1")["at_s"] > 0.0, 20.0)
        traffic, stolen_before_s = Traffic(daemon.address, "held", args), stolen_s()
        say(f"{plate_s:g} s of plate time beside {args.watchers} watchers and {args.rate:g} requests/s")
        job = daemon.ended(job["id"], 3.0 * plate_s + 60.0)
        taken_s, counts = stolen_s() - stolen_before_s, traffic.finish()
    print("\n".join(counts.lines()), end="\n\n")
    judge(job, counts, plate_s, taken_s).close()


def judge(job, counts, plate_s, taken_s):
    bars, report = Bars(), job["report"] or {}
    ran_s = report.get("plate_time_s", 0.0)
    bars.hold("the job ran its time, s", f">= {plate_s:g}", f"{ran_s:g} ({job['state']}: {job['reason']})", ran_s >= plate_s)
    late = report.get("worst_late_frames")
    bars.hold("worst frames late", f"<= {LATE_BAR_FRAMES}", late, late is not None and late <= LATE_BAR_FRAMES)
    bars.tell("deadlines missed", report.get("deadline_misses"))
    bars.tell("time the host took from all cores, s", f"{taken_s:.2f}")
    found = counts.job_requests_ms()
    p99 = percentile(found, 0.99)
    bars.hold(f"p99 of {len(found)} job requests, ms", f"<= {P99_BAR_MS:g}", f"{p99:.2f}", p99 <= P99_BAR_MS)
    judge_traffic(bars, counts)
    return bars


if __name__ == "__main__":
    main()
