"""One run as one process: its folder, and what it said on stderr."""
import json
import pathlib
import subprocess

# a process that takes longer than a run may is ended this many times later
KILL_AFTER = 1.5


def allowed_s(job):
    """Wall time that a run of this job may take, s."""
    return 3.0 * job["limits"]["plate_time_s"] + 20.0


def ended(command, most_s):
    """Exit status and stderr of a process."""
    # in a group of its own: Ctrl-C ends the campaign, not its runs
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "process_group": 0}
    try:
        done = subprocess.run(list(map(str, command)), text=True, errors="replace", timeout=KILL_AFTER * most_s, **quiet)
    except subprocess.TimeoutExpired:
        return -9, "it does not end"
    return done.returncode, done.stderr


def run_folder(out):
    """The folder that a run made below `out`; `None` when it was refused."""
    found = sorted(path.parent for path in pathlib.Path(out).glob("*/effective.json"))
    return found[0] if found else None


class Runner:
    """Starts runs of one build."""

    def __init__(self, upm):
        self.upm = upm

    def run(self, job, faults, folder):
        """Runs `job` with `faults`: its folder, or `None`."""
        folder = pathlib.Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        if faults:
            job = job | {"faults": [fault.row() for fault in faults]}
        (folder / "job.json").write_text(json.dumps(job, indent=1) + "\n")
        out = folder / "out"
        ended([self.upm, "run", folder / "job.json", "--out", out, "--rerun", "off", "--json", "--quiet"], allowed_s(job))
        return run_folder(out)

    def verify(self, run, job):
        """`None` when the run repeats byte for byte, else what `upm verify` said."""
        status, said = ended([self.upm, "verify", run], allowed_s(job))
        return None if status == 0 else said.strip() or f"exit status {status}"
