#!/usr/bin/env python3
"""A plus sign in default settings beside busy processes: it completes, however far it falls behind real time.

usage: daemon_busy.py [--busy 6] [--upm target/debug/upm]

busy      `--busy` processes that do nothing but count run beside the daemon, as nice as the threads of its plates;
          `configs/plus-sign.json` is submitted as it is
frozen    SIGSTOP for `--frozen` seconds while the same job runs: the plate falls that far behind, and the job goes on

Exit status 1 when a job did not complete.
"""
import contextlib
import json
import os
import signal
import subprocess
import sys
import time

from daemon_lib import ROOT, Bars, Daemon, parser_of, say, work_folder, write_config
from machine_probe import MachineProbe

PLATE = "upm-1"
# with the niceness that a daemon with the right to it gives its plates, else with the one that both started with
COUNTS = """
import contextlib, os
with contextlib.suppress(OSError):
    os.setpriority(os.PRIO_PROCESS, 0, -10)
while True:
    pass
"""


@contextlib.contextmanager
def busy_processes(count):
    processes = [subprocess.Popen([sys.executable, "-c", COUNTS]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


def shipped_plus_sign():
    job = json.loads((ROOT / "configs/plus-sign.json").read_text())
    del job["rig"]
    return job | {"plate": PLATE}


def finish(bars, daemon, what, job, within_s):
    """Waits for the end of the job and tells what became of it; its report."""
    row = daemon.wait_end(job["id"], within_s)
    report = row["report"] or {}
    bars.hold(f"{what}: the job", "completed", f"{row['state']}: {row['reason']}", row["state"] == "completed")
    bars.tell("  plate time, s", report.get("plate_time_s"))
    bars.tell("  wall time, s", report.get("wall_time_s"))
    bars.tell("  fell behind, s", report.get("behind_s"))
    bars.tell("  deadlines missed", report.get("deadline_misses"))
    bars.tell("  worst frames late", report.get("worst_late_frames"))
    bars.tell("  its recording", row["recording"])
    plate = daemon.plate(PLATE)
    bars.hold("  its plate", "idle", f"{plate['state']}: {plate['why']}", plate["state"] == "idle")
    return report


def main():
    parser = parser_of(__doc__)
    parser.add_argument("--busy", type=int, default=6, help="busy processes (6)")
    parser.add_argument("--frozen", type=float, default=8.0, help="how long the daemon is stopped, s (8)")
    parser.add_argument("--within", type=float, default=900.0, help="longest time for one job, s (900)")
    args = parser.parse_args()
    bars = Bars()
    with work_folder(args.keep) as folder:
        config = write_config(folder, {PLATE: PLATE})
        with Daemon(args.upm, folder, config).start() as daemon:
            say(f"beside {args.busy} busy processes")
            with busy_processes(args.busy):
                probe = MachineProbe()
                job = daemon.submit(shipped_plus_sign())
                finish(bars, daemon, f"beside {args.busy} busy processes", job, args.within)
                bars.tell("  cores stood still for more than a frame", probe.finish().words())
            say(f"stopped for {args.frozen:g} s")
            job = daemon.submit(shipped_plus_sign())
            daemon.wait_moving(job["id"], 0.5)
            os.kill(daemon.pid, signal.SIGSTOP)
            time.sleep(args.frozen)
            os.kill(daemon.pid, signal.SIGCONT)
            report = finish(bars, daemon, f"stopped for {args.frozen:g} s", job, args.within)
            behind_s = report.get("behind_s", 0.0)
            bars.hold("  fell behind, s", f">= {args.frozen - 0.1:g}", behind_s, behind_s >= args.frozen - 0.1)
    sys.exit(bars.close())


if __name__ == "__main__":
    main()
