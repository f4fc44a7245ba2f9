"""One run as one process, watched: exit status, wall time, memory, what it said on stderr."""
import json
import os
import pathlib
import subprocess
import time
from dataclasses import dataclass

# a process that takes longer than the oracle allows is ended this many times later
KILL_AFTER = 1.5


@dataclass(frozen=True)
class Process:
    """How a process ended."""

    status: int
    wall_s: float
    rss_mb: float
    stderr: str
    allowed_s: float


def allowed_s(job):
    """Wall time that a run of this job may take, s."""
    return 3.0 * job["limits"]["plate_time_s"] + 20.0


def watched(command, most_s, log):
    """Runs `command` with its stderr in the file `log`."""
    begin = time.monotonic()
    # in a group of its own: Ctrl-C ends the campaign, not its runs
    with open(log, "w") as stderr:
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=stderr, process_group=0)
    while True:
        pid, status, usage = os.wait4(child.pid, os.WNOHANG)
        if pid:
            break
        if time.monotonic() - begin > KILL_AFTER * most_s:
            child.kill()
        time.sleep(0.005)
    child.returncode = os.waitstatus_to_exitcode(status)
    text = pathlib.Path(log).read_text(errors="replace")
    return Process(child.returncode, time.monotonic() - begin, usage.ru_maxrss / 1024, text, most_s)


def run_folder(out):
    """The folder that a run made below `out`; `None` when it was refused."""
    found = sorted(path.parent for path in pathlib.Path(out).glob("*/effective.json"))
    return found[0] if found else None


class Runner:
    """Starts runs of one build."""

    def __init__(self, upm, without_guard=None):
        self.upm, self.without_guard = upm, without_guard
        self.options = ["--rerun", "off", "--json", "--quiet"]
        if without_guard:
            self.options += ["--without-guard", without_guard]

    def run(self, job, faults, folder, in_job=True):
        """Runs `job` with `faults`, told in the job file or on the command line: its folder, or `None`, and its process."""
        folder = pathlib.Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        if faults and in_job:
            job = job | {"faults": [fault.row() for fault in faults]}
        (folder / "job.json").write_text(json.dumps(job, indent=1) + "\n")
        told = [] if in_job or not faults else ["--faults", ",".join(map(str, faults))]
        out = folder / "out"
        command = [self.upm, "run", folder / "job.json", *told, "--seed", str(job["seed"]), "--out", out, *self.options]
        process = watched(command, allowed_s(job), folder / "stderr.txt")
        return run_folder(out), process

    def verify(self, run, job, folder):
        """`None` when the run repeats byte for byte, else what `upm verify` said."""
        process = watched([self.upm, "verify", str(run)], allowed_s(job), pathlib.Path(folder) / "verify.txt")
        return None if process.status == 0 else process.stderr.strip() or f"exit status {process.status}"
