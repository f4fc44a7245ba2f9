#!/usr/bin/env python3
"""A full disk: emergency stop, API and store still answer, what is the matter is said, and it goes on when there is room.

usage: daemon_full_disk.py [--upm target/debug/upm]

A tmpfs of 64 MiB is the data folder (this needs root; without it the campaign says so and is skipped). While two plates run,
the disk is filled from outside: first so far that recordings have to stop, then to the last byte. Exit status 1 when
a bar is missed.
"""
import contextlib
import os
import subprocess
import sys
import time

from daemon_lib import FINAL, Bars, Daemon, DaemonFault, is_closed, parser_of, plus_sign, say, short_arrange, work_folder, write_config
from machine_probe import MachineProbe

SIZE_MIB = 64
MIN_FREE_MB, RESERVE_MB = 16.0, 8.0
# left by the first filling: below the limit of recordings, above the reserve
LOW_MB = 12.0
NOTICED_WITHIN_S = 10.0
BAR_MS = 20.0


@contextlib.contextmanager
def tmpfs(folder):
    """True where one could be mounted on `folder`."""
    folder.mkdir(exist_ok=True)
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={SIZE_MIB}m", "upm-full-disk", str(folder)], capture_output=True, text=True)
    if done.returncode:
        print(f"skipped: no tmpfs can be mounted: {done.stderr.strip()}")
        yield False
        return
    try:
        yield True
    finally:
        if subprocess.run(["umount", str(folder)], capture_output=True).returncode:
            subprocess.run(["umount", "-l", str(folder)], check=True)


def free_mb(folder):
    found = os.statvfs(folder)
    return 1e-6 * found.f_bavail * found.f_frsize


def fill(path, leave_mb):
    """Lets `path` grow until so much is left, or until nothing is."""
    with open(path, "ab", buffering=0) as file:
        while (room_mb := free_mb(path.parent) - leave_mb) > 0.0:
            try:
                file.write(bytes(int(min(max(1e6 * room_mb, 4096.0), 1 << 20))))
            except OSError:
                return


class Campaign:
    def __init__(self, daemon, bars):
        self.daemon, self.bars, self.big = daemon, bars, daemon.data / "somebody-elses-file"

    def status(self, what, bar, method, path, body=None):
        """Holds the status of an answer; the answer."""
        begin = time.monotonic()
        answer = self.daemon.ask(method, path, body)
        words = "" if answer.status < 400 else f" {answer.words()}"
        self.bars.hold(what, bar, f"{answer.status}{words} ({1e3 * (time.monotonic() - begin):.0f} ms)", answer.status == bar)
        return answer

    def within(self, what, check):
        """Holds that it comes to that in time."""
        begin = time.monotonic()
        try:
            self.daemon.wait_for(what, check, NOTICED_WITHIN_S, 0.1)
        except DaemonFault:
            self.bars.hold(what, f"within {NOTICED_WITHIN_S:g} s", "no", False)
            return False
        self.bars.hold(what, f"within {NOTICED_WITHIN_S:g} s", f"{time.monotonic() - begin:.1f} s", True)
        return True

    def run(self):
        daemon = self.daemon
        lasting = daemon.submit(plus_sign("upm-1", plate_time_s=40.0, name="lasting"))
        stopped = daemon.submit(plus_sign("upm-2", plate_time_s=40.0, name="stopped"))
        for job in (lasting, stopped):
            daemon.wait_moving(job["id"], 2.0)
        self.low(lasting)
        self.full(stopped)
        self.end(lasting)
        self.room_again()

    def low(self, lasting):
        say(f"{free_mb(self.daemon.data):.0f} MB free, filled to {LOW_MB:g} MB")
        fill(self.big, LOW_MB)
        run = self.daemon.run_folders(lasting["id"])[0]
        self.within("low disk: the recording is closed and whole", lambda: is_closed(run / "run.rrd"))
        state = self.daemon.get(f"/v1/jobs/{lasting['id']}")["state"]
        self.bars.hold("low disk: the job goes on", "running", state, state == "running")

    def full(self, stopped):
        fill(self.big, 0.0)
        say(f"{free_mb(self.daemon.data):.1f} MB free")
        self.within("full disk: /readyz says so", lambda: self.daemon.ask("GET", "/readyz").status == 503)
        self.status("full disk: /readyz", 503, "GET", "/readyz")
        self.status("full disk: a job is submitted", 507, "POST", "/v1/jobs", short_arrange("upm-1"))
        for path in ("/healthz", "/v1/jobs", f"/v1/jobs/{stopped['id']}", "/v1/plates", "/metrics", "/openapi.json", "/"):
            self.status(f"full disk: GET {path.replace(stopped['id'], 'ID')}", 200, "GET", path)
        moving = self.daemon.plate("upm-2")
        self.bars.hold("full disk: the other plate still runs", "running", moving["state"], moving["state"] == "running")
        answer = self.status("full disk: emergency stop", 200, "POST", "/v1/plates/upm-2/estop")
        told = answer.json() if answer.status == 200 else {}
        self.bars.hold("  silent, and on the disk", "True, True", f"{told.get('silent')}, {told.get('persisted')}", bool(told.get("silent") and told.get("persisted")))
        times = [told.get(key) for key in ("requested_at_s", "silent_at_s")]
        ms = 1e3 * (times[1] - times[0]) if None not in times else float("nan")
        self.bars.hold("  request to zero force, ms of plate time", f"<= {BAR_MS:g}", f"{ms:.3f}", ms <= BAR_MS)
        ended = lambda: self.daemon.get(f"/v1/jobs/{stopped['id']}")["state"] in FINAL
        self.within("full disk: the end of the stopped job is stored", ended)
        job = self.daemon.get(f"/v1/jobs/{stopped['id']}")
        self.bars.hold("  as", "cancelled", f"{job['state']}: {job['reason']}", job["state"] == "cancelled")

    def end(self, lasting):
        job = self.daemon.wait_end(lasting["id"], 120.0)
        self.bars.hold("full disk: the running job ends as it would", "completed", f"{job['state']}: {job['reason']}", job["state"] == "completed")
        self.bars.hold("  its recording", "stopped", job["recording"], job["recording"] == "stopped")
        late = (job["report"] or {}).get("worst_late_frames")
        self.bars.hold("  worst frames late", "<= 1", late, late is not None and late <= 1)

    def room_again(self):
        self.big.unlink()
        say(f"{free_mb(self.daemon.data):.0f} MB free again")
        self.within("room again: /readyz says so", lambda: self.daemon.ask("GET", "/readyz").status == 200)
        self.daemon.act("/v1/plates/upm-2/reset", {"operator": "campaign", "reason": "room again"})
        self.daemon.act("/v1/plates/upm-2/resume")
        for plate in ("upm-1", "upm-2"):
            answer = self.status(f"room again: a job for {plate}", 201, "POST", "/v1/jobs?pace=max", short_arrange(plate))
            job = self.daemon.wait_end(answer.json()["id"], 60.0) if answer.status == 201 else {"state": "-", "recording": "-"}
            found = f"{job['state']}, {job['recording']}"
            self.bars.hold("  it ends, recorded", "completed, whole", found, found == "completed, whole")


def main():
    args = parser_of(__doc__).parse_args()
    bars = Bars()
    with work_folder(args.keep) as folder, tmpfs(folder / "data") as mounted:
        if not mounted:
            return
        disk = {"min_free_mb": MIN_FREE_MB, "reserve_mb": RESERVE_MB}
        config = write_config(folder, {"upm-1": "upm-1", "upm-2": "upm-2"}, default_plate="upm-1", disk=disk)
        with Daemon(args.upm, folder, config).start() as daemon:
            probe = MachineProbe()
            try:
                Campaign(daemon, bars).run()
            except DaemonFault as fault:
                bars.hold("the campaign goes through", "yes", fault, False)
                say("\n".join(f"{plate['name']}: {plate['state']} {plate['why']}" for plate in daemon.get("/v1/plates")["plates"]))
            bars.tell("cores stood still for more than a frame", probe.finish().words())
    sys.exit(bars.close())


if __name__ == "__main__":
    main()
