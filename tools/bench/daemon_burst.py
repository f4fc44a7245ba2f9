#!/usr/bin/env python3
"""A thousand jobs submitted at once: each is accepted or refused with Retry-After, and all are accounted for.

usage: daemon_burst.py [--jobs 1000] [--connections 1000] [--queue 128] [--drain] [--upm target/debug/upm]

Jobs go to three plates in turn, each with an idempotency key and, unless fewer are asked for, over a connection of its
own. Afterwards the list of jobs is read page by page: it has every accepted job once, and no other. With --drain those
that were refused come back when Retry-After says, until all are accepted, and all are run. Exit status 1 when a bar is
missed.
"""
import asyncio
import collections
import json
import sys
import time

from daemon_lib import Bars, Daemon, hold, parser_of, percentile, say, work_folder, write_config
from daemon_traffic import Link

PLATES = {"a": "upm-1", "b": "upm-2", "c": "upm-2-evening"}
LONGEST_DRAIN_S = 1800.0


def body(number):
    job = hold(list(PLATES)[number % len(PLATES)], 0.1, seed=number + 1, name=f"burst-{number}")
    return json.dumps(job).encode()


async def submit_all(address, numbers, connections):
    """Answers by number, or the exception that came in place of one."""
    left, answers = collections.deque(numbers), {}

    async def work():
        link = Link(address)
        while left:
            number = left.popleft()
            key = f"Idempotency-Key: burst-{number}\r\n"
            try:
                answers[number] = await asyncio.wait_for(link.ask("POST", "/v1/jobs?pace=max", body(number), key), 30.0)
            except (OSError, asyncio.IncompleteReadError, asyncio.TimeoutError) as fault:
                answers[number] = fault
                link.drop()
        link.drop()

    await asyncio.gather(*(work() for _ in range(connections)))
    return answers


def sorted_out(answers):
    """Ids of accepted jobs by number; numbers by the s after which they may come again; what should not have come."""
    accepted, refused, wrong = {}, {}, collections.Counter()
    for number, answer in answers.items():
        if isinstance(answer, Exception):
            wrong[type(answer).__name__] += 1
        elif answer.status == 201:
            accepted[number] = answer.json()["id"]
        elif answer.status == 429 and answer.headers.get("retry-after", "").isdigit():
            refused[number] = int(answer.headers["retry-after"])
        else:
            wrong[f"{answer.status} {answer.words()}"] += 1
            # not what it should be told, and yet it may come again
            refused |= {number: int(wait)} if (wait := answer.headers.get("retry-after", "")).isdigit() else {}
    return accepted, refused, wrong


def account(bars, daemon, accepted, when):
    """Holds the list of jobs against those that were accepted."""
    rows = [job["id"] for job in daemon.all_jobs()]
    wanted = set(accepted.values())
    bars.hold(f"{when}: rows of {len(wanted)} accepted jobs", len(wanted), len(rows), len(rows) == len(wanted))
    lost, strange = len(wanted - set(rows)), len(set(rows) - wanted)
    bars.hold(f"{when}: lost, unknown, twice", "0, 0, 0", f"{lost}, {strange}, {len(rows) - len(set(rows))}", sorted(rows) == sorted(wanted))


def drain(bars, daemon, accepted, refused, connections):
    """Those that were refused come again; then all have to be run."""
    begin, tries, wrong = time.monotonic(), 0, collections.Counter()
    due = {number: begin + wait_s for number, wait_s in refused.items()}
    while due and time.monotonic() - begin < LONGEST_DRAIN_S:
        now = time.monotonic()
        numbers = [number for number, at in due.items() if at <= now]
        more, again, odd = sorted_out(asyncio.run(submit_all(daemon.address, numbers, min(connections, len(numbers)))))
        accepted |= more
        wrong += odd
        tries += len(numbers)
        due = {number: at for number, at in due.items() if number not in more and number not in again}
        due |= {number: time.monotonic() + wait_s for number, wait_s in again.items()}
        say(f"  {len(accepted)} accepted, {len(due)} to come")
        time.sleep(0.25)
    bars.hold("drain: accepted in the end", f"{len(accepted) + len(due)}", len(accepted), not due)
    bars.hold("drain: other answers", "none", dict(wrong) or "none", not wrong)
    bars.tell("drain: submissions until then", tries)
    states = lambda: collections.Counter(job["state"] for job in daemon.all_jobs())
    is_done = lambda: not (found := states())["queued"] and not found["running"]
    daemon.wait_for("the end of all jobs", is_done, LONGEST_DRAIN_S, 1.0)
    found = states()
    bars.hold("drain: completed", len(accepted), dict(found), found["completed"] == len(accepted))
    bars.tell("drain: took, s", f"{time.monotonic() - begin:.1f}")


def main():
    parser = parser_of(__doc__)
    parser.add_argument("--jobs", type=int, default=1000)
    parser.add_argument("--connections", type=int, default=1000)
    parser.add_argument("--queue", type=int, default=128, help="places in the queue of each plate")
    parser.add_argument("--drain", action="store_true", help="come back until all are accepted and run")
    args = parser.parse_args()
    bars = Bars()
    with work_folder(args.keep) as folder:
        config = write_config(folder, PLATES, queue=args.queue)
        with Daemon(args.upm, folder, config).start() as daemon:
            say(f"{args.jobs} jobs over {args.connections} connections")
            begin = time.monotonic()
            answers = asyncio.run(submit_all(daemon.address, range(args.jobs), args.connections))
            took_s = time.monotonic() - begin
            accepted, refused, wrong = sorted_out(answers)
            whole = args.jobs - sum(wrong.values())
            bars.hold("accepted, or 429 with Retry-After", args.jobs, f"{len(accepted)} + {whole - len(accepted)}", whole == args.jobs)
            bars.hold("other answers", "none", dict(wrong) or "none", not wrong)
            wall_ms = [1e3 * answer.wall_s for answer in answers.values() if not isinstance(answer, Exception)]
            figures = ", ".join(f"{percentile(wall_ms, share):.1f}" for share in (0.5, 0.99, 1.0))
            bars.tell("all answered after, s", f"{took_s:.2f}")
            bars.tell("an answer took, ms: p50, p99, max", figures)
            account(bars, daemon, accepted, "at once")
            if args.drain:
                drain(bars, daemon, accepted, refused, args.connections)
                account(bars, daemon, accepted, "in the end")
            health = daemon.ask("GET", "/healthz").status
            bars.hold("/healthz afterwards", 200, health, health == 200)
    sys.exit(bars.close())


if __name__ == "__main__":
    main()
