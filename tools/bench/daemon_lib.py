"""What the campaigns against `upm serve` share: a daemon of their own, ways to talk to it, job bodies, a table of bars.

Every campaign starts its daemon on a free port with a data folder of its own, and ends it. Only the standard library.
"""
import argparse
import contextlib
import http.client
import json
import math
import os
import pathlib
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field

ROOT = pathlib.Path(__file__).resolve().parents[2]
FINAL = {"completed", "failed", "cancelled", "interrupted"}
# the last bytes of a recording that was closed: where its footer is, this word, a count of one
FOOTER_WORD = b"RRF2FOOT"
# bytes of a closed recording without a message: header, end, footer
EMPTY_RECORDING = 60

sys.path.append(str(ROOT / "tools"))


def say(text):
    """Progress, on stderr."""
    print(text, file=sys.stderr, flush=True)


def parser_of(doc, **defaults):
    """A parser with the options every campaign has."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--upm", default=str(ROOT / "target/debug/upm"), help="the program (target/debug/upm)")
    parser.add_argument("--seed", type=int, default=1, help="of everything random in the campaign (1)")
    parser.add_argument("--keep", type=pathlib.Path, help="empty folder to work in, kept afterwards; else a temporary one")
    parser.set_defaults(**defaults)
    return parser


@contextlib.contextmanager
def work_folder(keep):
    """`keep`, made, or a temporary folder that is gone afterwards."""
    if keep:
        keep.mkdir(parents=True, exist_ok=True)
        if any(keep.iterdir()):
            sys.exit(f"{keep} is not empty: what is left there would be taken for this campaign's")
        yield keep.resolve()
        return
    with tempfile.TemporaryDirectory(prefix="upm-daemon-") as folder:
        yield pathlib.Path(folder)


def write_config(folder, plates, **others):
    """Writes `daemon.json`; `plates` are names of rigs by names of plates, `others` the other keys."""
    rig = lambda name: str(ROOT / f"configs/rigs/{name}.json")
    config = {"plates": [{"name": name, "rig": rig(of)} for name, of in plates.items()]} | others
    path = folder / "daemon.json"
    path.write_text(json.dumps(config, indent=1))
    return path


# jobs


def plus_sign(plate, laps=0, plate_time_s=600.0, seed=7, name="plus-sign"):
    """A penny along the plus sign; without laps until its time is up."""
    task = {"type": "plus_sign", "laps": laps, "edge_margin_mm": 8}
    return job(plate, name, [{"kind": "penny"}], task, plate_time_s, seed)


def hold(plate, duration_s, seed=7, name="hold", **others):
    """A penny that stays where it is: nothing moves."""
    return job(plate, name, [{"kind": "penny"}], {"type": "hold", "duration_s": duration_s}, 600.0, seed) | others


def short_arrange(plate, seed=7, name="short"):
    """A penny that goes some millimetres: half a second of plate time or so."""
    task = {"type": "arrange", "targets_mm": [[6.0, 0.0]]}
    return job(plate, name, [{"kind": "penny", "position_mm": [0.0, 0.0]}], task, 60.0, seed)


def job(plate, name, parts, task, plate_time_s, seed):
    limits = {"plate_time_s": plate_time_s}
    return {"name": name, "plate": plate, "seed": seed, "parts": parts, "task": task, "limits": limits}


# a daemon


class DaemonFault(Exception):
    """The daemon did not do what a campaign cannot go on without."""


@dataclass
class Answer:
    status: int
    headers: dict
    body: bytes
    wall_s: float

    def json(self):
        return json.loads(self.body)

    def words(self):
        """Title and detail of a problem."""
        with contextlib.suppress(ValueError, AttributeError):
            problem = self.json()
            return f"{problem.get('title', '')}: {problem.get('detail', '')}"
        return self.body[:200].decode(errors="replace")


class Daemon:
    """`upm serve` as a child process."""

    def __init__(self, upm, folder, config, data=None, token=None):
        self.upm, self.folder, self.config = str(pathlib.Path(upm).resolve()), folder, config
        self.data = data or folder / "data"
        self.token = token
        self.process, self.address, self.first_line = None, None, ""

    def start(self, within_s=30.0):
        """Starts it and waits for its address."""
        self.launch()
        if not self.listens(within_s):
            raise DaemonFault(f"no address within {within_s:g} s; its last words:\n{self.last_words()}")
        return self

    def launch(self):
        """Starts it and waits for nothing."""
        command = [self.upm, "serve", "--config", self.config, "--listen", "127.0.0.1:0", "--data", self.data]
        self.address, self.first_line = None, ""
        with open(self.folder / "daemon.log", "ab") as log:
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, start_new_session=True)
        os.set_blocking(self.process.stdout.fileno(), False)

    def listens(self, within_s):
        """True once it has said its address, on the first line of stdout."""
        until = time.monotonic() + within_s
        while self.address is None and time.monotonic() < until:
            ready, _, _ = select.select([self.process.stdout], [], [], max(0.0, until - time.monotonic()))
            piece = self.process.stdout.read() if ready else None
            if piece == b"" or (piece is None and self.process.poll() is not None):
                return False
            self.first_line += (piece or b"").decode()
            found = re.match(r"(?:http://)?([\d.]+):(\d+)\s*\n", self.first_line)
            self.address = (found[1], int(found[2])) if found else None
        return self.address is not None

    @property
    def url(self):
        return f"http://{self.address[0]}:{self.address[1]}"

    @property
    def pid(self):
        return self.process.pid

    def last_words(self, lines=12):
        text = (self.folder / "daemon.log").read_text(errors="replace")
        return "\n".join(text.splitlines()[-lines:])

    def kill(self):
        """`kill -9`; the moment it was sent."""
        at = time.monotonic()
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        return at

    def terminate(self, within_s=10.0):
        """SIGTERM; how long it took to end, s, and its exit status, None when it did not in time."""
        begin = time.monotonic()
        self.process.terminate()
        try:
            status = self.process.wait(within_s)
        except subprocess.TimeoutExpired:
            return time.monotonic() - begin, None
        return time.monotonic() - begin, status

    def end(self):
        """Ends it in any case."""
        if self.process and self.process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGCONT)
            if self.terminate(5.0)[1] is None:
                self.kill()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()

    def ask(self, method, path, body=None, headers=None, within_s=30.0):
        """One request on a connection of its own. `body`: an object to be sent as JSON, or bytes."""
        connection = http.client.HTTPConnection(*self.address, timeout=within_s)
        headers = dict(headers or {})
        if self.token:
            headers.setdefault("Authorization", f"Bearer {self.token}")
        if body is not None and not isinstance(body, bytes):
            body = json.dumps(body).encode()
        if body is not None:
            headers.setdefault("Content-Type", "application/json")
        try:
            connection.connect()
            begin = time.perf_counter()
            connection.request(method, path, body, headers)
            found = connection.getresponse()
            content = found.read()
            wall_s = time.perf_counter() - begin
        finally:
            connection.close()
        return Answer(found.status, {k.lower(): v for k, v in found.getheaders()}, content, wall_s)

    def get(self, path):
        """The JSON of an answer that has to be 200."""
        answer = self.ask("GET", path)
        if answer.status != 200:
            raise DaemonFault(f"GET {path}: {answer.status} {answer.words()}")
        return answer.json()

    def submit(self, body, pace="real-time", key=None, wanted=201):
        """The job that was queued."""
        headers = {"Idempotency-Key": key} if key else {}
        answer = self.ask("POST", f"/v1/jobs?pace={pace}", body, headers)
        if answer.status != wanted:
            raise DaemonFault(f"POST /v1/jobs: {answer.status} {answer.body[:500].decode(errors='replace')}")
        return answer.json()

    def act(self, path, body=None, wanted=200):
        answer = self.ask("POST", path, body)
        if answer.status != wanted:
            raise DaemonFault(f"POST {path}: {answer.status} {answer.words()}")
        return answer.json()

    def plate(self, name):
        return next(plate for plate in self.get("/v1/plates")["plates"] if plate["name"] == name)

    def hold_plate(self, name):
        """Leaves the plate paused: whatever is queued for it waits."""
        self.act(f"/v1/plates/{name}/estop")
        self.act(f"/v1/plates/{name}/reset", {"operator": "campaign", "reason": "to hold it"})

    def wait_for(self, what, check, within_s, every_s=0.02):
        """The first value of `check` that counts."""
        until = time.monotonic() + within_s
        while True:
            found = check()
            if found:
                return found
            if time.monotonic() > until:
                raise DaemonFault(f"not within {within_s:g} s: {what}")
            time.sleep(every_s)

    def wait_end(self, job_id, within_s):
        """The job, once it has ended."""
        ended = lambda: (lambda job: job if job["state"] in FINAL else None)(self.get(f"/v1/jobs/{job_id}"))
        return self.wait_for(f"the end of job {job_id}", ended, within_s)

    def wait_moving(self, job_id, at_s, within_s=20.0):
        """The plate, once the job on it has come to plate time `at_s`."""

        def moving():
            plates = self.get("/v1/plates")["plates"]
            return next((p for p in plates if p["job"] == job_id and p["at_s"] >= at_s), None)

        return self.wait_for(f"job {job_id} on its plate", moving, within_s)

    def all_jobs(self, limit=200):
        """Every job there is, page by page."""
        jobs, cursor = [], ""
        while True:
            page = self.get(f"/v1/jobs?limit={limit}{cursor}")
            jobs += page["jobs"]
            if not page["next"]:
                return jobs
            cursor = f"&cursor={page['next']}"

    def run_folders(self, job_id):
        return sorted(self.data.glob(f"runs/*{job_id}*"))


def is_closed(recording):
    """True for a recording with a footer: it was closed."""
    if not recording.is_file() or recording.stat().st_size < EMPTY_RECORDING:
        return False
    with open(recording, "rb") as file:
        head = file.read(4)
        file.seek(-16, os.SEEK_END)
        return head == b"RRF2" and FOOTER_WORD in file.read()


# figures


def percentile(found, share):
    """By nearest rank; NaN of nothing."""
    return sorted(found)[max(0, math.ceil(share * len(found)) - 1)] if found else math.nan


@dataclass
class Bars:
    """What was to be held and what was measured; figures without a bar stand among them."""

    rows: list = field(default_factory=list)

    def hold(self, what, bar, measured, held):
        self.rows.append((what, str(bar), str(measured), "yes" if held else "NO"))

    def tell(self, what, measured):
        self.rows.append((what, "-", str(measured), "-"))

    def close(self):
        """Prints the table; the exit status."""
        rows = [("what", "bar", "measured", "held"), *self.rows]
        widths = [max(len(row[i]) for row in rows) for i in range(3)]
        for row in rows:
            print("  ".join(cell.ljust(width) for cell, width in zip(row, widths)) + "  " + row[3])
        return 1 if any(row[3] == "NO" for row in self.rows) else 0


def memory_mb(pid):
    """Resident, proportional and private memory of a process, MB of 10⁶ bytes."""
    kb = lambda text, key: int(re.search(rf"^{key}:\s+(\d+) kB", text, re.M)[1])
    status = pathlib.Path(f"/proc/{pid}/status").read_text()
    rollup = pathlib.Path(f"/proc/{pid}/smaps_rollup").read_text()
    private = kb(rollup, "Private_Clean") + kb(rollup, "Private_Dirty")
    return {"VmRSS": kb(status, "VmRSS") * 1.024e-3, "Pss": kb(rollup, "Pss") * 1.024e-3, "Private": private * 1.024e-3}


def upm_run(upm, body, rig, folder):
    """The run folder of a job that `upm run` made on its own, as fast as it can."""
    path = folder / f"{body['name']}.json"
    path.write_text(json.dumps({k: v for k, v in body.items() if k != "plate"} | {"rig": str(ROOT / f"configs/rigs/{rig}.json")}))
    out = folder / f"alone-{body['name']}"
    shutil.rmtree(out, ignore_errors=True)
    done = subprocess.run([str(pathlib.Path(upm).resolve()), "run", path, "--out", out, "-q"], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(done.stderr.strip())
    return next(out.iterdir())
