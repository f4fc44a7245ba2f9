"""`upm serve` for `page_test.py`, and jobs for it."""
import contextlib
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parent.parent
SLOW_JOB = {"name": "slow", "plate": "upm-2", "parts": [{"kind": "penny", "count": 3}],
            "task": {"type": "hold", "duration_s": 300}, "limits": {"plate_time_s": 400}}
BAD_JOB = """{
  "name": "bad",
  "seed": "seven",
  "parts": [
    {"kind": "penny"},
    {"kind": "pony"}
  ],
  "colour": 3,
  "task": {"type": "hold", "duration_s": 1}
}
"""


class Daemon:
    """`upm serve` with a data folder of its own."""

    def __init__(self, upm, folder, token=None):
        self.upm, self.folder, self.token = upm, pathlib.Path(folder), token
        spec = json.loads((ROOT / "configs/daemon.json").read_text())
        for plate in spec["plates"]:
            plate.pop("standing_job", None)  # the page is looked at with jobs that are sent
            plate["rig"] = str(ROOT / "configs" / plate["rig"])
        spec["queue"] = 300
        spec["allow_faults"] = True
        if token:
            (self.folder / "token").write_text(token + "\n")
            (self.folder / "token").chmod(0o600)
            spec["token_file"] = str(self.folder / "token")
        self.plates = [plate["name"] for plate in spec["plates"]]
        self.config = self.folder / "daemon.json"
        self.config.write_text(json.dumps(spec))
        self.listen = "127.0.0.1:0"
        self.start()

    def start(self):
        with open(self.folder / "log.txt", "a") as log:
            args = ["serve", "--config", self.config, "--listen", self.listen, "--data", self.folder / "data"]
            self.process = subprocess.Popen([self.upm, *args], stdout=subprocess.PIPE, stderr=log, text=True)
        line = self.process.stdout.readline().strip()
        if not line:
            sys.exit(f"{self.upm} serve did not start:\n{(self.folder / 'log.txt').read_text()}")
        self.url = line if line.startswith("http") else f"http://{line}"
        self.listen = self.url.removeprefix("http://").rstrip("/")

    def ask(self, path, body=None):
        return json.loads(self.read(path, body))

    def read(self, path, body=None):
        headers = {"Content-Type": "application/json"} | ({"Authorization": f"Bearer {self.token}"} if self.token else {})
        data = json.dumps(body).encode() if body is not None else None
        with urllib.request.urlopen(urllib.request.Request(self.url.rstrip("/") + path, data, headers), timeout=10) as answer:
            return answer.read().decode()

    def records(self):
        """False for a build that makes no recordings."""
        version = subprocess.run([self.upm, "--version"], stdout=subprocess.PIPE, text=True, check=True).stdout
        return "rerun" not in version

    def streams(self):
        """Event streams that are open."""
        return int(float(re.search(r"^upm_event_streams (\S+)$", self.read("/metrics"), re.MULTILINE)[1]))

    def jobs(self):
        return self.ask("/v1/jobs?limit=200")["jobs"]

    def plate(self, name):
        return next(plate for plate in self.ask("/v1/plates")["plates"] if plate["name"] == name)

    def tell(self, number):
        os.kill(self.process.pid, number)

    def end(self, number=signal.SIGTERM):
        with contextlib.suppress(ProcessLookupError):
            self.tell(signal.SIGCONT)
            self.tell(number)
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
