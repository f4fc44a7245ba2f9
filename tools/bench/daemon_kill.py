#!/usr/bin/env python3
"""`kill -9` at random moments: no job that was accepted is lost or run twice, recordings are whole to a second.

usage: daemon_kill.py [--rounds 200] [--upm target/debug/upm] [--venv target/daemon-recordings]

Three plates run long jobs and short ones. Every other round is under camera load: real time, four clients that fetch
frame.png without a pause; the others run as fast as the machine can. Jobs are submitted with idempotency keys until
the kill, and cancelled at times. One round in four kills the next daemon within 0.3 s of its start, again and again, while
it puts things in order; one in ten makes an emergency stop first. After each restart:

  jobs        every acknowledged one is there; one without an answer is there or is not, and its key tells which
  states      what had ended is unchanged, nothing is running, what had begun did not begin again: one run folder, one
              journal, one time of start
  plates      paused, or stopped where an emergency stop had been on the disk; nothing moves for half a second
  recordings  open up to the kill; every series has every row that was due a second before it, held against the same
              job run to its end by `upm run`; so does the journal

Recordings are read with rerun-sdk, installed from PyPI into the folder `--venv` when it is not there. Exit status 1 when
anything of this does not hold.
"""
import collections
import http.client
import itertools
import pathlib
import random
import sys
import threading
import time
from dataclasses import dataclass, field

from daemon_lib import (
    FINAL, ROOT, Bars, Daemon, DaemonFault, is_closed, parser_of, percentile, plus_sign, say, short_arrange, upm_run,
    work_folder, write_config,
)
from machine_probe import stolen_s
from virtual_env import enter_venv

PLATES = ("upm-1", "upm-2", "upm-2-evening")
COMPLETE_TO_S = 1.0
STILL_S = 0.5
LONG_S = 300.0
CAMERAS = 4
# a queue longer than this is shortened
MOST_QUEUED = 6
EARLY_S, LATE_S = (0.0, 0.3), (0.3, 6.0)
SAMPLE_EVERY_S = 0.03
NETWORK = (OSError, DaemonFault, ValueError, http.client.HTTPException)


@dataclass
class Known:
    """What is known of a job from answers."""

    body: dict
    key: str
    id: str = ""
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
    # (when on the wall, plate time) by job, as seen
    seen: dict = field(default_factory=lambda: collections.defaultdict(list))
    # what the host had taken from all cores: when, s
    stolen: list = field(default_factory=list)
    queued: dict = field(default_factory=dict)
    pictures: int = 0

    def start(self):
        works = [self.submit, self.sample, *[self.fetch] * self.cameras]
        self.threads = [threading.Thread(target=self.keep, args=(work,), daemon=True) for work in works]
        for thread in self.threads:
            thread.start()
        return self

    def keep(self, work):
        while not self.over.is_set():
            try:
                work()
            except NETWORK:
                time.sleep(0.01)

    def end(self):
        self.over.set()
        for thread in self.threads:
            thread.join()

    def submit(self):
        plate = self.rng.choice(PLATES)
        if self.queued.get(plate, 0) > MOST_QUEUED:
            self.books.cancel_one(self.daemon, plate)
        else:
            self.books.submit(self.daemon, self.books.new_job(plate, self.rng), self.pace)
        self.over.wait(self.rng.uniform(0.05, 0.3))

    def sample(self):
        before = time.monotonic()
        plates = self.daemon.get("/v1/plates")["plates"]
        middle = 0.5 * (before + time.monotonic())
        self.stolen.append((middle, stolen_s()))
        for plate in plates:
            self.queued[plate["name"]] = plate["queued"]
            if plate["job"] and plate["age_s"] is not None:
                self.seen[plate["job"]].append((middle - plate["age_s"], plate["at_s"]))
        self.over.wait(SAMPLE_EVERY_S)

    def fetch(self):
        for job in list(self.seen)[-3:] or [self.over.wait(0.05)]:
            if job and not self.over.is_set():
                self.pictures += self.daemon.ask("GET", f"/v1/jobs/{job}/frame.png").status == 200


class Books:
    """Every job that was sent, and what is known of it."""

    def __init__(self):
        self.numbers, self.lock = itertools.count(1), threading.Lock()
        self.known, self.unanswered, self.refused = {}, [], collections.Counter()

    def new_job(self, plate, rng):
        number = next(self.numbers)
        is_long = rng.random() < 0.4
        body = plus_sign(plate, plate_time_s=LONG_S, name=f"long-{plate}") if is_long else short_arrange(plate, number)
        return Known(body, f"kill-{number}")

    def submit(self, daemon, job, pace):
        """Sends it once; without an answer it is remembered as such."""
        with self.lock:
            self.unanswered.append((job, pace))
        answer = daemon.ask("POST", f"/v1/jobs?pace={pace}", job.body, {"Idempotency-Key": job.key})
        with self.lock:
            self.unanswered.remove((job, pace))
            if answer.status == 201:
                job.row = answer.json()
                job.id = job.row["id"]
                self.known[job.id] = job
            else:
                self.refused[f"{answer.status} {answer.words()[:60]}"] += 1
        return answer

    def cancel_one(self, daemon, plate):
        """Takes the newest job that waits for the plate out of its queue."""
        waiting = daemon.get("/v1/jobs?state=queued&limit=200")["jobs"]
        job = next((job for job in waiting if job["plate"] == plate), None)
        answer = daemon.ask("POST", f"/v1/jobs/{job['id']}/cancel") if job else None
        # one that had begun meanwhile is still being stopped, and may end as interrupted
        if answer and answer.status == 200 and answer.json()["state"] == "cancelled" and job["id"] in self.known:
            self.known[job["id"]].cancelled = True


class Campaign:
    def __init__(self, args, folder):
        config = write_config(folder, {name: name for name in PLATES}, queue=1000)
        self.daemon = Daemon(args.upm, folder, config)
        self.rng, self.books = random.Random(args.seed), Books()
        self.wrong, self.counts = collections.Counter(), collections.Counter()
        # seconds on the wall by which a series is short of the kill, by what it belongs to
        self.short_s = collections.defaultdict(list)
        # looks at what the host took from all cores in the present round: when, s
        self.stolen = []
        self.starts_s, self.ended_early, self.failed = [], collections.Counter(), collections.Counter()
        self.whole = make_references(args.upm, folder)

    def blame(self, what, detail=""):
        self.wrong[what] += 1
        say(f"  WRONG: {what} {detail}")

    def round(self, number):
        under_camera = number % 2 == 0
        load = Load(self.daemon, self.books, "real-time" if under_camera else "max", CAMERAS if under_camera else 0, self.rng)
        for plate in PLATES:
            self.daemon.act(f"/v1/plates/{plate}/resume")
        load.start()
        time.sleep(self.rng.uniform(*LATE_S))
        stopped = self.stop_one() if self.rng.random() < 0.1 else None
        killed_at = self.daemon.kill()
        load.end()
        self.counts["under camera load"] += under_camera
        self.counts["pictures"] += load.pictures
        self.stolen = load.stolen
        self.daemon.launch()
        while self.rng.random() < 0.25:
            time.sleep(self.rng.uniform(*EARLY_S))
            self.daemon.kill()
            self.counts["within 0.3 s of a start"] += 1
            self.daemon.launch()
        begin = time.monotonic()
        if not self.daemon.listens(30.0):
            raise DaemonFault(f"it does not start again:\n{self.daemon.last_words()}")
        self.starts_s.append(time.monotonic() - begin)
        self.check(stopped, load.seen, killed_at)

    def stop_one(self):
        """Name of a plate whose emergency stop was on the disk before the kill."""
        plate = self.rng.choice(PLATES)
        told = self.daemon.act(f"/v1/plates/{plate}/estop")
        self.counts["after an emergency stop"] += 1
        return plate if told["persisted"] else None

    def run_names(self):
        """Names of the run folders."""
        return {run.name for run in self.daemon.data.glob("runs/*")}

    def check(self, stopped, seen, killed_at):
        rows = {row["id"]: row for row in self.check_still(stopped)}
        self.check_lost(rows)
        for job in self.books.known.values():
            if job.id in rows:
                self.check_job(job, rows[job.id], seen, killed_at)
        if stopped:
            self.daemon.act(f"/v1/plates/{stopped}/reset", {"operator": "campaign", "reason": "after a kill"})

    def check_still(self, stopped):
        """Nothing moves by itself; the rows of all jobs."""
        before = self.daemon.all_jobs()
        folders = self.run_names()
        time.sleep(STILL_S)
        for plate in self.daemon.get("/v1/plates")["plates"]:
            wanted = "stopped" if plate["name"] == stopped else "paused"
            if plate["state"] != wanted or plate["job"]:
                self.blame(f"a plate is {plate['state']} after a kill, not {wanted}", plate["name"])
        if self.run_names() - folders or any(row["state"] == "running" for row in before):
            self.blame("a job began by itself")
        after = self.daemon.all_jobs()
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
            answer = self.books.submit(self.daemon, job, pace)
            replayed = answer.headers.get("idempotency-replayed") == "true"
            self.counts["without an answer, but there" if replayed else "without an answer, not there"] += 1
            if replayed != (job.id in strange):
                self.blame("a key does not tell whether its job is there", job.key)
            strange.discard(job.id)
        if strange:
            self.blame("a job that no client sent", sorted(strange))
        for job in self.rng.sample(list(self.books.known.values()), min(2, len(self.books.known))):
            headers = {"Idempotency-Key": job.key}
            answer = self.daemon.ask("POST", f"/v1/jobs?pace={job.row['pace']}", job.body, headers)
            same = answer.status == 201 and answer.json()["id"] == job.id
            if not same or answer.headers.get("idempotency-replayed") != "true":
                self.blame("a key is forgotten", f"{job.key}: {answer.status} {answer.words()}")

    def check_job(self, job, row, seen, killed_at):
        before, job.row = job.row, row
        if before["state"] in FINAL and (row["state"], row["finished_at"]) != (before["state"], before["finished_at"]):
            self.blame("a job that had ended changed", f"{before['state']} to {row['state']}, {job.id}")
        if before["started_at"] and row["started_at"] != before["started_at"]:
            self.blame("a job began twice", job.id)
        if job.cancelled and row["state"] != "cancelled":
            self.blame("a cancelled job is not", f"{row['state']}, {job.id}")
        folders = self.daemon.run_folders(job.id)
        if len(folders) > (row["state"] != "queued"):
            self.blame("run folders that should not be", f"{row['state']} with {len(folders)}, {job.id}")
        if before["state"] in FINAL or row["state"] not in FINAL or not folders:
            return
        self.counts[row["state"]] += 1
        if row["state"] == "failed":
            self.failed[row["reason"]] += 1
        run = folders[0]
        journal = (run / "journal.jsonl").read_bytes() if (run / "journal.jsonl").exists() else b""
        if journal.count(b'{"type":"localised"') > 1:
            self.blame("a job was run twice", job.id)
        self.check_recording(row, run)
        if row["state"] == "interrupted":
            self.check_complete(job, run, journal, seen.get(job.id, []), killed_at)

    def check_recording(self, row, run):
        self.counts[f"recording {row['recording']}"] += 1
        if row["recording"] == "whole" and not is_closed(run / "run.rrd"):
            self.blame("a recording is not closed", f"{row['recording']}, {run.name}")

    def check_complete(self, job, run, journal, seen, killed_at):
        """Every row that was due a second before the kill is there."""
        whole = self.whole.get(job.body["name"])
        if whole is None or not seen or not (run / "run.rrd").exists():
            self.counts["interrupted, nothing to compare"] += 1
            return
        self.counts["interrupted, compared"] += 1
        until_s = whole.journal_until_s(journal)
        if until_s is None:
            self.blame("a journal differs from that of the whole run", run.name)
            return
        self.note_short("journal", until_s, seen, killed_at, run)
        early = early_end_of(run / "run.rrd")
        if early:
            self.ended_early[early] += 1
            return
        for (entity, _), missing_s in whole.first_missing_s(run / "run.rrd").items():
            if missing_s is not None:
                self.note_short(entity.split("/")[1], missing_s, seen, killed_at, run)

    def note_short(self, group, due_s, seen, killed_at, run):
        """`due_s`: plate time of the first that is missing; it was due when the plate was first seen past that."""
        past = next((wall for wall, at_s in seen if at_s >= due_s), killed_at)
        short_s = killed_at - past
        self.short_s[group].append(short_s)
        if short_s > COMPLETE_TO_S:
            taken = f"the host took {self.stolen_between(past - 1.0, killed_at):.2f} s of all cores in that time and the second before"
            self.blame("a series is short of the kill by more than a second", f"{group} by {short_s:.2f} s, {run.name}; {taken}")

    def stolen_between(self, begin, end):
        """Time that the host of a virtual machine took from all cores then, as far as it was looked at, s."""
        within = [stolen for wall, stolen in self.stolen if begin <= wall <= end]
        return max(within, default=0.0) - min(within, default=0.0)


def early_end_of(recording):
    """What a recording says of its early end, if it does."""
    from daemon_recordings import EARLY_END, texts_of

    return next((text for text in texts_of(recording) if text.startswith(EARLY_END)), None)


def make_references(upm, folder):
    """The whole runs of the long jobs, by name of the job."""
    from daemon_recordings import Whole

    jobs = {plate: plus_sign(plate, plate_time_s=LONG_S, name=f"long-{plate}") for plate in PLATES}
    say(f"{len(jobs)} whole runs to compare with")
    return {job["name"]: Whole(upm_run(upm, job, plate, folder)) for plate, job in jobs.items()}


def judge(campaign, rounds):
    bars, counts, wrong = Bars(), campaign.counts, campaign.wrong
    bars.hold("rounds", rounds, counts["rounds"], counts["rounds"] == rounds)
    for what in ("under camera load", "within 0.3 s of a start", "after an emergency stop", "pictures"):
        bars.tell(f"  {what}", counts[what])
    bars.tell("jobs acknowledged", len(campaign.books.known))
    for what in ("without an answer, but there", "without an answer, not there", *sorted(FINAL)):
        bars.tell(f"  {what}", counts[what])
    for what in sorted(key for key in counts if key.startswith("recording ")):
        bars.tell(what, counts[what])
    bars.tell("interrupted runs compared", f"{counts['interrupted, compared']} ({counts['interrupted, nothing to compare']} not)")
    for group, found in sorted(campaign.short_s.items()):
        worst = max(found)
        what = f"  {group}: short of the kill, s, p99 {percentile(found, 0.99):.2f}, worst"
        bars.hold(what, f"<= {COMPLETE_TO_S:g}", f"{worst:.2f}", worst <= COMPLETE_TO_S)
    bars.tell("recordings that said they end early", dict(campaign.ended_early) or "none")
    bars.tell("why jobs failed", dict(campaign.failed) or "none did")
    bars.tell("submissions refused", dict(campaign.books.refused) or "none")
    bars.tell("longest start, s", f"{max(campaign.starts_s, default=0.0):.2f}")
    bars.hold("what does not hold", "nothing", dict(wrong) or "nothing", not wrong)
    return bars


def main():
    parser = parser_of(__doc__)
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--venv", type=pathlib.Path, default=ROOT / "target/daemon-recordings")
    args = parser.parse_args()
    enter_venv(args.venv, ["rerun-sdk==0.36.3"], ["rerun.experimental"])
    with work_folder(args.keep) as folder:
        campaign = Campaign(args, folder)
        with campaign.daemon:
            campaign.daemon.start()
            for number in range(args.rounds):
                campaign.round(number)
                campaign.counts["rounds"] += 1
                say(f"round {number + 1}: {len(campaign.books.known)} jobs, wrong: {dict(campaign.wrong) or 'nothing'}")
    sys.exit(judge(campaign, args.rounds).close())


if __name__ == "__main__":
    main()
