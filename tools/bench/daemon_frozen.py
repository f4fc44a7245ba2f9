#!/usr/bin/env python3
"""A daemon that is frozen, clients that are, and an end with all of them connected.

usage: daemon_frozen.py [--upm target/debug/upm]

frozen daemon   SIGSTOP for a second under strict deadlines: the plate was not driven, so the job fails by its drive lease where
                a pulse was being played, else by late frames. daemon_busy.py has the same under relaxed deadlines
frozen clients  64 that ask for events and never read, one that asks for pictures and never reads: no deadline is missed by
                more than a frame
SIGTERM         with 50 event clients, 5 frozen ones and 5 that sent half a header: ended within 2 s, the recording whole, the
                job interrupted

Exit status 1 when a bar is missed.
"""
import contextlib
import os
import random
import signal
import socket
import sys
import threading
import time

from daemon_lib import Bars, Daemon, is_closed, parser_of, plus_sign, say, work_folder, write_config
from machine_probe import MachineProbe

FROZEN_S = 1.0
END_BAR_S = 2.0
PLATE = "upm-1"


class Client:
    """A raw connection that sent something and reads nothing, or throws away what it reads."""

    def __init__(self, daemon, text, reads=False):
        self.socket = socket.socket()
        # a small window, so that the daemon's sends soon block
        if not reads:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.socket.settimeout(10.0)
        self.socket.connect(daemon.address)
        self.socket.sendall(text.encode())
        self.bytes, self.text = 0, b""
        if reads:
            threading.Thread(target=self.read, daemon=True).start()

    def read(self):
        with contextlib.suppress(OSError):
            while piece := self.socket.recv(65536):
                self.bytes += len(piece)
                self.text = (self.text + piece)[-200:]

    def close(self):
        self.socket.close()


def request(daemon, path):
    return f"GET {path} HTTP/1.1\r\nHost: {daemon.address[0]}:{daemon.address[1]}\r\n\r\n"


def frozen_daemon(bars, daemon, rng):
    job = daemon.submit(plus_sign(PLATE, plate_time_s=60.0) | {"deadlines": "strict"})
    daemon.wait_moving(job["id"], 0.1)
    time.sleep(rng.uniform(0.0, 1.0))
    os.kill(daemon.pid, signal.SIGSTOP)
    time.sleep(FROZEN_S)
    os.kill(daemon.pid, signal.SIGCONT)
    row = daemon.wait_end(job["id"], 10.0)
    code = ((row["report"] or {}).get("stop") or {}).get("code")
    bars.hold("frozen daemon: the job", "failed", f"{row['state']}: {row['reason']}", row["state"] == "failed")
    bars.hold("  its code", "deadline_missed", code, code == "deadline_missed")
    plate = daemon.plate(PLATE)
    bars.hold("  its plate", "paused", f"{plate['state']}: {plate['why']}", plate["state"] == "paused")
    folder = daemon.run_folders(job["id"])[0]
    bars.hold("  its recording is whole", "yes", row["recording"], row["recording"] == "whole" and is_closed(folder / "run.rrd"))


def frozen_clients(bars, daemon, seconds):
    daemon.act(f"/v1/plates/{PLATE}/resume")
    probe = MachineProbe()
    job = daemon.submit(plus_sign(PLATE, plate_time_s=seconds))
    daemon.wait_moving(job["id"], 0.1)
    events, frame = (request(daemon, f"/v1/jobs/{job['id']}/{what}") for what in ("events", "frame.png"))
    clients = [Client(daemon, events) for _ in range(64)] + [Client(daemon, frame * 100)]
    seen = Client(daemon, events, reads=True)
    # pictures are drawn only for a client that asked for them
    while daemon.get(f"/v1/jobs/{job['id']}")["state"] == "running":
        daemon.ask("GET", f"/v1/jobs/{job['id']}/frame.png")
        time.sleep(0.5)
    row, machine = daemon.wait_end(job["id"], 10.0), probe.finish()
    report = row["report"] or {}
    late = report.get("worst_late_frames")
    bars.hold("frozen clients: the job", "completed", f"{row['state']}: {row['reason']}", row["state"] == "completed")
    bars.hold("  worst frames late", "<= 1", late, late is not None and late <= 1)
    bars.tell("  deadlines missed", report.get("deadline_misses"))
    bars.tell("  cores stood still for more than a frame", machine.words())
    bars.hold("  the stream of a client that reads ended in order", "yes", f"{seen.bytes} bytes", seen.text.endswith(b"0\r\n\r\n"))
    for client in [*clients, seen]:
        client.close()


def sigterm(bars, daemon):
    daemon.act(f"/v1/plates/{PLATE}/resume")
    job = daemon.submit(plus_sign(PLATE, plate_time_s=60.0))
    waiting = daemon.submit(plus_sign(PLATE, plate_time_s=60.0))
    daemon.wait_moving(job["id"], 1.0)
    events = request(daemon, f"/v1/jobs/{job['id']}/events")
    readers = [Client(daemon, events, reads=True) for _ in range(50)]
    clients = [Client(daemon, events) for _ in range(5)]
    daemon.wait_for("all event clients", lambda: all(reader.bytes > 200 for reader in readers), 10.0)
    clients += [Client(daemon, "GET /v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Ha") for _ in range(5)]
    took_s, status = daemon.terminate()
    bars.hold("SIGTERM: ended after, s", f"<= {END_BAR_S:g}", f"{took_s:.2f}", status is not None and took_s <= END_BAR_S)
    bars.hold("  exit status", 0, status, status == 0)
    time.sleep(0.2)
    ended = sum(reader.text.endswith(b"0\r\n\r\n") for reader in readers)
    bars.hold("  event streams that ended in order", len(readers), ended, ended == len(readers))
    run = daemon.run_folders(job["id"])[0]
    bars.hold("  the recording is whole", "yes", "run.rrd", is_closed(run / "run.rrd"))
    for client in [*clients, *readers]:
        client.close()
    daemon.start()
    row = daemon.get(f"/v1/jobs/{job['id']}")
    bars.hold("  the job after a restart", "interrupted", f"{row['state']}: {row['reason']}", row["state"] == "interrupted")
    bars.hold("  its recording after a restart", "whole", row["recording"], row["recording"] == "whole")
    state = daemon.get(f"/v1/jobs/{waiting['id']}")["state"]
    bars.hold("  the job that waited", "queued", state, state == "queued")
    plate = daemon.plate(PLATE)
    bars.hold("  its plate", "paused", f"{plate['state']}: {plate['why']}", plate["state"] == "paused")


def main():
    parser = parser_of(__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="plate time beside the frozen clients")
    args = parser.parse_args()
    bars = Bars()
    with work_folder(args.keep) as folder:
        config = write_config(folder, {PLATE: PLATE})
        with Daemon(args.upm, folder, config).start() as daemon:
            say("frozen daemon")
            frozen_daemon(bars, daemon, random.Random(args.seed))
            say("frozen clients")
            frozen_clients(bars, daemon, args.seconds)
            say("SIGTERM")
            sigterm(bars, daemon)
    sys.exit(bars.close())


if __name__ == "__main__":
    main()
