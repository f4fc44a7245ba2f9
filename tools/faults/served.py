"""`upm serve` with a data folder and a free port of its own, and its HTTP API as an operator's client uses it."""
import contextlib
import json
import pathlib
import subprocess
import time
import urllib.error
import urllib.request

from .jobs import ROOT

# an answer, the end of the process and its first line may take so long, s
ANSWER_S, END_S = 20.0, 15.0
POLL_S = 0.02
ENDED = ("completed", "failed", "cancelled", "interrupted")


class Hangs(Exception):
    """The daemon, or what is asked of it, does not come to the expected state in time."""


def configuration(plates):
    """configs/daemon.json with faults allowed and these plates (name: rig object)."""
    spec = json.loads((ROOT / "configs/daemon.json").read_text())
    spec.pop("default_plate")
    spec |= {
        "plates": [{"name": name, "rig": rig} for name, rig in plates.items()],
        "allow_faults": True,
    }
    return spec


class Served:
    """A running daemon; ends with its `with` block."""

    def __init__(self, upm, folder, plates):
        self.upm, self.folder = upm, pathlib.Path(folder)
        self.log, self.data = self.folder / "daemon.txt", self.folder / "data"
        self.config = self.folder / "daemon.json"
        self.config.write_text(json.dumps(configuration(plates), indent=1) + "\n")

    def __enter__(self):
        args = ["serve", "--config", self.config, "--listen", "127.0.0.1:0", "--data", self.data]
        # in a group of its own: Ctrl-C ends the jobs under way, and the daemon after them
        with open(self.log, "w") as log:
            command = [self.upm, *args]
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, process_group=0)
        line = self.process.stdout.readline().strip()
        if not line:
            raise SystemExit(f"{self.upm} serve did not start:\n{self.said()[-2000:]}")
        self.url = (line if line.startswith("http") else f"http://{line}").rstrip("/")
        return self

    def __exit__(self, *_):
        self.process.terminate()
        try:
            self.process.wait(END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def said(self):
        return self.log.read_text(errors="replace")

    def ask(self, method, path, body=None):
        """Status and body of an answer, problem documents included."""
        data = json.dumps(body).encode() if body is not None else b"" if method == "POST" else None
        headers = {"Content-Type": "application/json"} if body is not None else {}
        request = urllib.request.Request(self.url + path, data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=ANSWER_S) as answer:
                return answer.status, json.loads(answer.read())
        except urllib.error.HTTPError as problem:
            text = problem.read()
            with contextlib.suppress(ValueError):
                return problem.code, json.loads(text)
            return problem.code, {"detail": text.decode(errors="replace")}
        except (urllib.error.URLError, OSError) as fault:
            raise Hangs(f"no answer to {method} {path}: {fault}") from fault

    def submit(self, job, plate, faults=(), pace="max"):
        """Status and answer of a job sent to a plate, whose rig it takes."""
        sent = {key: value for key, value in job.items() if key != "rig"} | {"plate": plate}
        if faults:
            sent["faults"] = [fault.row() for fault in faults]
        return self.ask("POST", f"/v1/jobs?pace={pace}", sent)

    def job(self, id):
        return self.ask("GET", f"/v1/jobs/{id}")[1]

    def plate(self, name):
        plates = self.ask("GET", "/v1/plates")[1]["plates"]
        return next(plate for plate in plates if plate["name"] == name)

    def tell(self, plate, act, body=None):
        """Status and answer of `estop`, `reset` or `resume`."""
        return self.ask("POST", f"/v1/plates/{plate}/{act}", body)

    def ended(self, id, most_s):
        """The job once it has ended."""
        return self.until(lambda: self.job(id), lambda job: job["state"] in ENDED, most_s, f"job {id} has not ended")

    def until(self, look, is_so, most_s, otherwise):
        """The first look that shows what is waited for."""
        begin = time.monotonic()
        while True:
            seen = look()
            if is_so(seen):
                return seen
            if time.monotonic() - begin > most_s:
                raise Hangs(f"{otherwise} after {most_s:.0f} s")
            if self.process.poll() is not None:
                raise Hangs(f"the daemon has ended, exit status {self.process.returncode}")
            time.sleep(POLL_S)

    def run_folder(self, id):
        """The folder of the run of a job; `None` before it has one."""
        return next((self.data / "runs").glob(f"*-{id}"), None)

    def restore(self, plate):
        """Brings a plate back to an empty queue, ready for the next case, whatever the case before left behind."""
        for job in self.ask("GET", "/v1/jobs?limit=200")[1]["jobs"]:
            if job["plate"] == plate and job["state"] not in ENDED:
                self.ask("POST", f"/v1/jobs/{job['id']}/cancel")
                self.ended(job["id"], ANSWER_S)
        if self.plate(plate)["state"] == "stopped":
            self.tell(plate, "reset", {"operator": "campaign", "reason": "the case is over"})
        if self.plate(plate)["state"] == "paused":
            self.tell(plate, "resume")
