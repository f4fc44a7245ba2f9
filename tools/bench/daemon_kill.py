#!/usr/bin/env python3
"""`kill -9` at random moments: no job that was accepted is lost or run twice.

usage: daemon_kill.py [--rounds 200] [--upm target/debug/upm]

Three plates run long jobs and short ones, submitted with idempotency keys until the kill, some cancelled. Every other round is
in real time with four clients that fetch frame.png without a pause. One round in four kills the next daemon within 0.3 s of its
start, again and again; one in ten makes an emergency stop first. After each restart:

  jobs        every acknowledged one is there; one without an answer is there or is not, and its key tells which
  states      what had ended is unchanged, nothing is running, what had begun did not begin again: one run folder, one
              journal, one time of start
  plates      paused, or stopped where an emergency stop had been on the disk; nothing moves for half a second
  journals    those of interrupted long jobs begin as that of the same job run to its end by `upm run`

Exit status 1 when anything of this does not hold.
"""
import collections
import itertools
import json
import random
import threading
import time
from dataclasses import dataclass, field

from daemon_lib import ROOT, options_of, plus_sign, say, serving, short_arrange
from common import Bars, report_of
from upm_daemon import FINAL, Daemon, DaemonFault

PLATES = ("upm-1", "upm-2", "upm-2-evening")
STILL_S, LONG_S = 0.5, 300.0
CAMERAS = 4
# a queue longer than this is shortened
MOST_QUEUED = 6
EARLY_S, LATE_S = (0.0, 0.3), (0.3, 6.0)
NOT_CYCLES = (b'{"type":"event"', b'{"type":"unfinished_cycle"')


@dataclass
class Known:
    """What is known of a job from answers."""

    body: dict
    key: str
    row: dict = field(default_factory=dict)
    cancelled: bool = False


@dataclass
class Load:
    """All that goes on from a start to the kill, on threads of its own."""

    daemon: Daemon
    books: "Books"
    pace: str
    cameras: int
    rng: random.Random
    over: threading.Event = field(default_factory=threading.Event)
    pictures: int = 0

    def start(self):
        works = [self.submit, *[self.fetch] * self.cameras]
        self.threads = [threading.Thread(target=self.keep, args=(work,), daemon=True) for work in works]
        for thread in self.threads:
            thread.start()
        return self

    def keep(self, work):
        while not self.over.is_set():
            try:
                work()
            except (DaemonFault, ValueError):
                time.sleep(0.01)

    def end(self):
        self.over.set()
        for thread in self.threads:
            thread.join()

    def submit(self):
        plate = self.daemon.plate(self.rng.choice(PLATES))
        if plate["queued"] > MOST_QUEUED:
            self.books.cancel_one(self.daemon, plate["name"])
        else:
            self.books.submit(self.daemon, self.books.new_job(plate["name"], self.rng), self.pace)
        self.over.wait(self.rng.uniform(0.05, 0.3))

    def fetch(self):
        for plate in self.daemon.get("/v1/plates")["plates"]:
            if plate["job"] and not self.over.is_set():
                self.pictures += self.daemon.ask("GET", f"/v1/jobs/{plate['job']}/frame.png").status == 200


class Books:
    """Every job that was sent, and what is known of it."""

    def __init__(self):
        self.numbers, self.lock = itertools.count(1), threading.Lock()
        self.known, self.unanswered, self.refused = {}, [], collections.Counter()

    def new_job(self, plate, rng):
        number = next(self.numbers)
        return Known(long_job(plate) if rng.random() < 0.4 else short_arrange(plate, number), f"kill-{number}")

    def submit(self, daemon, job, pace):
        """Sends it once; without an answer it is remembered as such."""
        with self.lock:
            self.unanswered.append((job, pace))
        answer = daemon.ask("POST", f"/v1/jobs?pace={pace}", job.body, {"Idempotency-Key": job.key})
        with self.lock:
            self.unanswered.remove((job, pace))
            if answer.status == 201:
                job.row = answer.json()
                self.known[job.row["id"]] = job
            else:
                self.refused[f"{answer.status} {answer.words()[:60]}"] += 1
        return answer

    def cancel_one(self, daemon, plate):
        """Takes the newest job that waits for the plate out of its queue."""
        job = next((job for job in daemon.jobs("&state=queued") if job["plate"] == plate), None)
        answer = daemon.ask("POST", f"/v1/jobs/{job['id']}/cancel") if job else None
        # one that had begun meanwhile is still being stopped, and may end as interrupted
        if answer and answer.status == 200 and answer.json()["state"] == "cancelled" and job["id"] in self.known:
            self.known[job["id"]].cancelled = True


def long_job(plate):
    return plus_sign(plate, plate_time_s=LONG_S, name=f"long-{plate}")


def cycles_of(journal):
    """The whole lines of a journal, without events and the pulses of a cycle that was broken off: how the run came to its end."""
    lines = journal[: journal.rfind(b"\n") + 1].splitlines(keepends=True)
    return b"".join(line for line in lines if not line.startswith(NOT_CYCLES))


def whole_journals(upm, folder):
    """The journals of the long jobs, run to their ends, by name of the job."""
    say(f"{len(PLATES)} whole runs to compare with")
    journals = {}
    for plate in PLATES:
        body, out = long_job(plate), folder / f"alone-{plate}"
        body["rig"] = str(ROOT / f"configs/rigs/{body.pop('plate')}.json")
        (folder / f"{plate}.json").write_text(json.dumps(body))
        report_of(upm, folder / f"{plate}.json", out, "--rerun", "off")
        journals[body["name"]] = cycles_of(next(out.glob("*/journal.jsonl")).read_bytes())
    return journals


class Campaign:
    def __init__(self, args, daemon):
        self.daemon, self.rng, self.books = daemon, random.Random(args.seed), Books()
        self.wrong, self.counts, self.failed = collections.Counter(), collections.Counter(), collections.Counter()
        self.starts_s = []
        self.whole = whole_journals(args.upm, daemon.folder)

    def blame(self, what, detail=""):
        self.wrong[what] += 1
        say(f"  WRONG: {what} {detail}")

    def round(self, number):
        under_camera = number % 2 == 0
        load = Load(self.daemon, self.books, "real-time" if under_camera else "max", CAMERAS if under_camera else 0, self.rng)
        for plate in PLATES:
            self.daemon.act(plate, "resume")
        load.start()
        time.sleep(self.rng.uniform(*LATE_S))
        stopped = self.stop_one() if self.rng.random() < 0.1 else None
        self.daemon.kill()
        load.end()
        self.counts["under camera load"] += under_camera
        self.counts["pictures"] += load.pictures
        self.daemon.launch()
        while self.rng.random() < 0.25:
            time.sleep(self.rng.uniform(*EARLY_S))
            self.daemon.kill()
            self.counts["within 0.3 s of a start"] += 1
            self.daemon.launch()
        begin = time.monotonic()
        if not self.daemon.listens(30.0):
            raise DaemonFault(f"it does not start again:\n{self.daemon.said()[-2000:]}")
        self.starts_s.append(time.monotonic() - begin)
        self.check(stopped)
        self.counts["rounds"] += 1

    def stop_one(self):
        """Name of a plate whose emergency stop was on the disk before the kill."""
        plate = self.rng.choice(PLATES)
        self.counts["after an emergency stop"] += 1
        return plate if self.daemon.act(plate, "estop")["persisted"] else None

    def check(self, stopped):
        rows = {row["id"]: row for row in self.check_still(stopped)}
        self.check_lost(rows)
        for job_id, job in self.books.known.items():
            if job_id in rows:
                self.check_job(job, rows[job_id])
        if stopped:
            self.daemon.reset(stopped, "after a kill")

    def check_still(self, stopped):
        """Nothing moves by itself; the rows of all jobs."""
        run_names = lambda: {run.name for run in self.daemon.data.glob("runs/*")}
        before, folders = self.daemon.jobs(), run_names()
        time.sleep(STILL_S)
        for plate in self.daemon.get("/v1/plates")["plates"]:
            wanted = "stopped" if plate["name"] == stopped else "paused"
            if plate["state"] != wanted or plate["job"]:
                self.blame(f"a plate is {plate['state']} after a kill, not {wanted}", plate["name"])
        if run_names() - folders or any(row["state"] == "running" for row in before):
            self.blame("a job began by itself")
        after = self.daemon.jobs()
        if before != after:
            self.blame("rows change though nothing moves")
        return after

    def check_lost(self, rows):
        for job_id in set(self.books.known) - set(rows):
            self.blame("an acknowledged job is lost", job_id)
            del self.books.known[job_id]
        strange = set(rows) - set(self.books.known)
        unanswered, self.books.unanswered = self.books.unanswered, []
        for job, pace in unanswered:
            replayed = is_replayed(self.books.submit(self.daemon, job, pace))
            self.counts["without an answer, but there" if replayed else "without an answer, not there"] += 1
            if replayed != (job.row.get("id") in strange):
                self.blame("a key does not tell whether its job is there", job.key)
            strange.discard(job.row.get("id"))
        if strange:
            self.blame("a job that no client sent", sorted(strange))
        for job in self.rng.sample(list(self.books.known.values()), min(2, len(self.books.known))):
            headers = {"Idempotency-Key": job.key}
            answer = self.daemon.ask("POST", f"/v1/jobs?pace={job.row['pace']}", job.body, headers)
            if not is_replayed(answer) or answer.json()["id"] != job.row["id"]:
                self.blame("a key is forgotten", f"{job.key}: {answer.status} {answer.words()}")

    def check_job(self, job, row):
        before, job.row = job.row, row
        if before["state"] in FINAL and (row["state"], row["finished_at"]) != (before["state"], before["finished_at"]):
            self.blame("a job that had ended changed", f"{before['state']} to {row['state']}, {row['id']}")
        if before["started_at"] and row["started_at"] != before["started_at"]:
            self.blame("a job began twice", row["id"])
        if job.cancelled and row["state"] != "cancelled":
            self.blame("a cancelled job is not", f"{row['state']}, {row['id']}")
        folders = self.daemon.run_folders(row["id"])
        if len(folders) > (row["state"] != "queued"):
            self.blame("run folders that should not be", f"{row['state']} with {len(folders)}, {row['id']}")
        if before["state"] in FINAL or row["state"] not in FINAL or not folders:
            return
        self.counts[row["state"]] += 1
        self.counts[f"recording {row['recording']}"] += 1
        if row["state"] == "failed":
            self.failed[row["reason"]] += 1
        path = folders[0] / "journal.jsonl"
        journal = path.read_bytes() if path.exists() else b""
        if journal.count(b'{"type":"localised"') > 1:
            self.blame("a job was run twice", row["id"])
        if row["state"] == "interrupted" and job.body["name"] in self.whole:
            self.counts["interrupted, compared"] += 1
            if not self.whole[job.body["name"]].startswith(cycles_of(journal)):
                self.blame("a journal differs from that of the whole run", folders[0].name)


def is_replayed(answer):
    return answer.status == 201 and answer.headers.get("idempotency-replayed") == "true"


def judge(campaign, rounds):
    bars, counts, wrong = Bars(), campaign.counts, campaign.wrong
    bars.hold("rounds", rounds, counts["rounds"], counts["rounds"] == rounds)
    for what in ("under camera load", "within 0.3 s of a start", "after an emergency stop", "pictures"):
        bars.tell(f"  {what}", counts[what])
    bars.tell("jobs acknowledged", len(campaign.books.known))
    for what in ("without an answer, but there", "without an answer, not there", *FINAL, "interrupted, compared"):
        bars.tell(f"  {what}", counts[what])
    for what in sorted(key for key in counts if key.startswith("recording ")):
        bars.tell(what, counts[what])
    bars.tell("why jobs failed", dict(campaign.failed) or "none did")
    bars.tell("submissions refused", dict(campaign.books.refused) or "none")
    bars.tell("longest start, s", f"{max(campaign.starts_s, default=0.0):.2f}")
    bars.hold("what does not hold", "nothing", dict(wrong) or "nothing", not wrong)
    return bars


def main():
    args = options_of(__doc__, rounds=200)
    with serving(args, {name: name for name in PLATES}, queue=1000) as daemon:
        campaign = Campaign(args, daemon)
        for number in range(args.rounds):
            campaign.round(number)
            say(f"round {number + 1}: {len(campaign.books.known)} jobs, wrong: {dict(campaign.wrong) or 'nothing'}")
    judge(campaign, args.rounds).close()


if __name__ == "__main__":
    main()
