"""The daemon of the campaign: it takes jobs with faults, and its plates are brought back to rest after each case."""
from upm_daemon import FINAL, Daemon


class Served(Daemon):
    def __init__(self, upm, folder, plates):
        super().__init__(upm, folder, plates, allow_faults=True)

    def send(self, job, plate, faults=(), pace="max"):
        """The answer to a job sent to a plate, whose rig it takes."""
        sent = {key: value for key, value in job.items() if key != "rig"} | {"plate": plate}
        if faults:
            sent["faults"] = [fault.row() for fault in faults]
        return self.ask("POST", f"/v1/jobs?pace={pace}", sent)

    def resume(self, plate):
        """The status of the answer."""
        return self.ask("POST", f"/v1/plates/{plate}/resume").status

    def restore(self, plate):
        """Brings a plate back to an empty queue, ready for the next case, whatever the case before left behind."""
        for job in self.jobs():
            if job["plate"] == plate and job["state"] not in FINAL:
                self.ask("POST", f"/v1/jobs/{job['id']}/cancel")
                self.ended(job["id"], 20.0)
        if self.plate(plate)["state"] == "stopped":
            self.reset(plate, "the case is over")
        if self.plate(plate)["state"] == "paused":
            self.resume(plate)
