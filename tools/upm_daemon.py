"""`upm serve` as a child process with a folder of its own and a free port, and its HTTP API as a client uses it."""
import contextlib
import http.client
import json
import os
import pathlib
import re
import select
import signal
import subprocess
import time
from dataclasses import dataclass

FINAL = ("completed", "failed", "cancelled", "interrupted")


class DaemonFault(Exception):
    """The daemon did not do what a tool cannot go on without."""


@dataclass
class Answer:
    status: int
    headers: dict
    body: bytes
    wall_s: float

    def json(self):
        return json.loads(self.body)

    def words(self):
        """Title and detail of a problem, with its first faults."""
        with contextlib.suppress(ValueError, AttributeError):
            problem = self.json()
            faults = "; ".join(f"{fault['path']}: {fault['found']}" for fault in problem.get("faults", ()))
            return f"{problem.get('title', '')}: {problem.get('detail', '')} {faults}".strip()[:200]
        return self.body[:200].decode(errors="replace")


class Daemon:
    """A daemon on `plates` (rigs by name: objects or files); `others` are the other keys of its configuration."""

    def __init__(self, upm, folder, plates, token=None, **others):
        self.upm, self.folder, self.token = str(pathlib.Path(upm).resolve()), pathlib.Path(folder), token
        self.data, self.log = self.folder / "data", self.folder / "daemon.log"
        self.plates = list(plates)
        spec = {"plates": [{"name": name, "rig": rig} for name, rig in plates.items()]}
        if token:
            path = self.folder / "token"
            path.write_text(token + "\n")
            path.chmod(0o600)
            spec["token_file"] = str(path)
        self.config = self.folder / "daemon.json"
        self.config.write_text(json.dumps(spec | others, indent=1))
        self.process, self.address, self.listen = None, None, "127.0.0.1:0"

    def start(self, within_s=30.0):
        """Starts it, on the port it had before, and waits for its address."""
        self.launch()
        if not self.listens(within_s):
            raise DaemonFault(f"{self.upm} serve does not start:\n{self.said()[-2000:]}")
        return self

    def launch(self):
        """Starts it and waits for nothing."""
        command = [self.upm, "serve", "--config", self.config, "--listen", self.listen, "--data", self.data]
        self.address, self.first_line = None, b""
        with open(self.log, "ab") as log:
            # in a session of its own: Ctrl-C ends the tool, and the tool ends its daemon
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, start_new_session=True)
        os.set_blocking(self.process.stdout.fileno(), False)

    def listens(self, within_s):
        """True once it has said its address, on the first line of stdout."""
        end = time.monotonic() + within_s
        while self.address is None and time.monotonic() < end:
            ready, _, _ = select.select([self.process.stdout], [], [], max(0.0, end - time.monotonic()))
            piece = self.process.stdout.read() if ready else None
            if piece == b"" or (piece is None and self.process.poll() is not None):
                return False
            self.first_line += piece or b""
            found = re.match(rb"(?:http://)?([\d.]+):(\d+)/?\s*\n", self.first_line)
            self.address = (found[1].decode(), int(found[2])) if found else None
        return self.address is not None

    @property
    def url(self):
        return f"http://{self.address[0]}:{self.address[1]}"

    def said(self):
        return self.log.read_text(errors="replace")

    def tell(self, number):
        os.kill(self.process.pid, number)

    def kill(self):
        """`kill -9`."""
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def end(self, within_s=15.0):
        """Ends it in any case."""
        if not self.process or self.process.poll() is not None:
            return
        self.tell(signal.SIGCONT)
        self.process.terminate()
        try:
            self.process.wait(within_s)
        except subprocess.TimeoutExpired:
            self.kill()

    def __enter__(self):
        return self.start()

    def __exit__(self, *_):
        self.end()

    def ask(self, method, path, body=None, headers=None, within_s=30.0):
        """The answer to one request on a connection of its own, problems included. `body` is sent as JSON."""
        connection = http.client.HTTPConnection(*self.address, timeout=within_s)
        headers = dict(headers or {}) | ({"Authorization": f"Bearer {self.token}"} if self.token else {})
        if body is not None:
            body, headers["Content-Type"] = json.dumps(body).encode(), "application/json"
        try:
            connection.connect()
            begin = time.perf_counter()
            connection.request(method, path, body, headers)
            found = connection.getresponse()
            content = found.read()
        except (OSError, http.client.HTTPException) as fault:
            status = self.process.poll()
            raise DaemonFault(f"no answer to {method} {path}: {fault!r}; exit status {status}") from fault
        finally:
            connection.close()
        return Answer(found.status, {k.lower(): v for k, v in found.getheaders()}, content, time.perf_counter() - begin)

    def get(self, path):
        return self.done("GET", path)

    def done(self, method, path, body=None, headers=None):
        """The JSON of an answer that has to be 200 or 201."""
        answer = self.ask(method, path, body, headers)
        if answer.status not in (200, 201):
            raise DaemonFault(f"{method} {path}: {answer.status} {answer.words()}")
        return answer.json()

    def submit(self, body, pace="real-time"):
        """The job that was queued."""
        return self.done("POST", f"/v1/jobs?pace={pace}", body)

    def act(self, plate, what, body=None):
        """`estop`, `reset` or `resume` of a plate."""
        return self.done("POST", f"/v1/plates/{plate}/{what}", body)

    def reset(self, plate, reason):
        return self.act(plate, "reset", {"operator": "campaign", "reason": reason})

    def cancel(self, job_id):
        return self.done("POST", f"/v1/jobs/{job_id}/cancel")

    def job(self, job_id):
        return self.get(f"/v1/jobs/{job_id}")

    def jobs(self, query=""):
        """Every job there is, newest first."""
        jobs, cursor = [], ""
        while True:
            page = self.get(f"/v1/jobs?limit=200{query}{cursor}")
            jobs += page["jobs"]
            if not page["next"]:
                return jobs
            cursor = f"&cursor={page['next']}"

    def plate(self, name):
        return next(plate for plate in self.get("/v1/plates")["plates"] if plate["name"] == name)

    def wait_for(self, what, look, within_s):
        """The first value of `look` that counts."""
        end = time.monotonic() + within_s
        while not (found := look()):
            if time.monotonic() > end:
                raise DaemonFault(f"not within {within_s:g} s: {what}")
            time.sleep(0.02)
        return found

    def ended(self, job_id, within_s):
        """The job once it has ended."""
        look = lambda: job if (job := self.job(job_id))["state"] in FINAL else None
        return self.wait_for(f"the end of job {job_id}", look, within_s)

    def run_folders(self, job_id):
        return sorted(self.data.glob(f"runs/*-{job_id}"))
