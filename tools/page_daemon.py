"""`upm serve` for `page_test.py`, and jobs for it."""
import re

from common import ROOT, config
from upm_daemon import Daemon

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


class PageDaemon(Daemon):
    """The shipped plates, without their standing jobs: the page is looked at with jobs that are sent."""

    def __init__(self, upm, folder, token=None):
        plates = {plate["name"]: str(ROOT / "configs" / plate["rig"]) for plate in config("daemon")["plates"]}
        super().__init__(upm, folder, plates, token, default_plate="upm-2", queue=300, allow_faults=True)
        self.start()
        # a killed daemon is started again at the address that the page has
        self.listen = f"{self.address[0]}:{self.address[1]}"

    def streams(self):
        """Event streams that are open."""
        return int(float(re.search(rb"^upm_event_streams (\S+)$", self.ask("GET", "/metrics").body, re.MULTILINE)[1]))

    def queue(self, name="slow", plate="upm-2"):
        """The id of a slow job."""
        return self.submit({**SLOW_JOB, "name": name, "plate": plate})["id"]

    def waiting(self, plate):
        return [job for job in self.jobs("&state=queued") if job["plate"] == plate]

    def stopped(self):
        """True while every plate is stopped."""
        return {plate["state"] for plate in self.get("/v1/plates")["plates"]} == {"stopped"}
