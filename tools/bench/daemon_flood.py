#!/usr/bin/env python3
"""Emergency stops while others flood the daemon with connections.

usage: daemon_flood.py [--stops 40] [--rate 25000] [--flooders 3] [--held 1248] [--upm target/debug/upm]

Addresses of the loopback hold every common connection with half a header each, and open them again when the daemon closes
them. Processes open new connections from the stop's own address as fast as asked, say nothing, and close each when 512
further ones are open. Meanwhile a client asks for emergency stops, each over a connection of its own and once: one that is
not answered with 200 counts as lost. A client's time is from before it connects to the answer received. The rate is what the
flooders reached while stops were asked for. Exit status 1 when a bar is missed.
"""
import collections
import multiprocessing
import os
import socket
import struct
import sys
import time

from daemon_lib import Bars, Daemon, parser_of, percentile, say, work_folder, write_config

PLATE = "upm-2"
BAR_MS = 50.0
# connections that one address of the loopback may hold, and that a flooder has open at once
OF_ONE_ADDRESS, OPEN_AT_ONCE = 256, 512
# between two stops, and the longest time for one, s
APART_S, LONGEST_S = 0.1, 5.0
HALF_A_HEADER = b"GET /v1/plates HTTP/1.1\r\nHost: local"
# closing resets the connection: its port is free at once
RESET = struct.pack("ii", 1, 0)
# connections between looks at the clock
BATCH = 50


def connected(address, source):
    link = socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
    if source:
        link.bind((source, 0))
    link.connect_ex(address)
    return link


def hold_common(address, count, ending):
    """Keeps `count` half headers standing, from as many addresses as that takes."""
    links = {}
    while not ending.is_set():
        for number in range(count):
            link = links.get(number)
            try:
                is_open = link is not None and link.recv(1) != b""
            except BlockingIOError:
                is_open = True
            except OSError:
                is_open = False
            if is_open:
                continue
            if link:
                link.close()
            links[number] = link = connected(address, f"127.0.1.{1 + number // OF_ONE_ADDRESS}")
            try:
                link.send(HALF_A_HEADER)
            except OSError:
                continue
        ending.wait(0.2)


def flood(address, rate, opened, ending):
    """Opens `rate` connections a second and says nothing over them."""
    links, begin, count = collections.deque(), time.monotonic(), 0
    while not ending.is_set():
        for _ in range(BATCH):
            links.append(connected(address, None))
            if len(links) > OPEN_AT_ONCE:
                links.popleft().close()
        count += BATCH
        opened.value += BATCH
        ahead_s = count / rate - (time.monotonic() - begin)
        if ahead_s > 0:
            time.sleep(ahead_s)
        else:
            begin, count = time.monotonic(), 0


def stop_times(daemon, stops):
    """How long each stop took, ms, and what came in place of those that were lost."""
    took_ms, lost = [], collections.Counter()
    for _ in range(stops):
        time.sleep(APART_S)
        begin = time.perf_counter()
        try:
            answer = daemon.ask("POST", f"/v1/plates/{PLATE}/estop", within_s=LONGEST_S)
        except OSError as fault:
            lost[type(fault).__name__] += 1
            continue
        if answer.status == 200:
            took_ms.append(1e3 * (time.perf_counter() - begin))
        else:
            lost[f"{answer.status} {answer.words()}"] += 1
    return took_ms, lost


def under_flood(daemon, args, flooders):
    """The stops beside so many flooders, the connections a second that these made, and the daemon's open files then."""
    ending, opened = multiprocessing.Event(), [multiprocessing.Value("q", 0, lock=False) for _ in range(flooders)]
    of_each = args.rate / max(1, flooders)
    others = [multiprocessing.Process(target=flood, args=(daemon.address, of_each, one, ending)) for one in opened]
    others.append(multiprocessing.Process(target=hold_common, args=(daemon.address, args.held, ending)))
    for other in others:
        other.start()
    try:
        time.sleep(2.0)
        before, begin = sum(one.value for one in opened), time.monotonic()
        took_ms, lost = stop_times(daemon, args.stops)
        rate = (sum(one.value for one in opened) - before) / (time.monotonic() - begin)
        files = len(os.listdir(f"/proc/{daemon.pid}/fd"))
    finally:
        ending.set()
        for other in others:
            other.join()
    return took_ms, lost, rate, files


def main():
    parser = parser_of(__doc__)
    parser.add_argument("--stops", type=int, default=40)
    parser.add_argument("--rate", type=float, default=25_000.0, help="new connections a second, of all flooders")
    parser.add_argument("--flooders", type=int, default=3, help="processes that open them")
    parser.add_argument("--held", type=int, default=1248, help="half headers that are held")
    args = parser.parse_args()
    bars = Bars()
    with work_folder(args.keep) as folder:
        with Daemon(args.upm, folder, write_config(folder, {PLATE: PLATE})).start() as daemon:
            for what, flooders in (("half headers alone", 0), ("flood", args.flooders)):
                say(what)
                took_ms, lost, rate, files = under_flood(daemon, args, flooders)
                three = ", ".join(f"{percentile(took_ms, share):.1f}" for share in (0.5, 0.99, 1.0))
                worst = percentile(took_ms, 0.99)
                bars.tell(f"{what}: new connections a second", f"{rate:.0f}")
                bars.hold(f"{what}: stops answered", args.stops, len(took_ms), len(took_ms) == args.stops)
                bars.hold(f"{what}: others", "none", dict(lost) or "none", not lost)
                bars.hold(f"{what}: connect to answer, ms, p99", f"<= {BAR_MS:g}", f"{worst:.1f}", worst <= BAR_MS)
                bars.tell(f"{what}: p50, p99, max", three)
                bars.tell(f"{what}: open files of the daemon", files)
            bars.tell("load average of the machine", ", ".join(f"{load:.1f}" for load in os.getloadavg()))
    sys.exit(bars.close())


if __name__ == "__main__":
    main()
