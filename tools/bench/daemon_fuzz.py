#!/usr/bin/env python3
"""Requests made up from the daemon's own OpenAPI document: no 5xx, no status or body that is not documented, no hang.

usage: daemon_fuzz.py [--examples 100] [--upm target/debug/upm] [--venv target/daemon-fuzz]

schemathesis, installed from PyPI into the folder `--venv` when it is not there, calls every operation of a running daemon,
with ids and names that exist in about half of the calls, and checks status, content type and body against the document.
Once without tokens, once with one, and once on a daemon that asks for one without showing it. All the while a job runs
beside it, plates that were stopped are reset, and jobs that were made are cancelled, so that event streams end.
Exit status 1 when a check fails, a request hangs or the daemon is not well afterwards.
"""
import json
import os
import pathlib
import re
import subprocess
import sys
import threading
from dataclasses import dataclass

from daemon_lib import FINAL, ROOT, Bars, Daemon, DaemonFault, parser_of, plus_sign, say, short_arrange, work_folder, write_config
from virtual_env import enter_venv

CHECKS = [
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "unsupported_method",
]
TOKEN = "campaign-token-0123456789-0123456789-0123456789"
# beyond the daemon's own longest answer, 10 s
REQUEST_TIMEOUT_S = 15.0
KEEP_TIDY_S = 0.5
# where the hooks find the id of the job that runs: only pictures are asked of it, since its events do not end
RUNNING_FILE = "running-job"
HOOKS = '''
import json, os, pathlib, random
import schemathesis

KNOWN = {key: os.environ["FUZZ_" + key.upper()].split(",") for key in ("id", "name", "file")}
RUNNING = os.environ["FUZZ_RUNNING"]
JOB = json.loads(os.environ["FUZZ_JOB"])
rng = random.Random(int(os.environ["FUZZ_SEED"]))


@schemathesis.hook
def map_path_parameters(context, path_parameters):
    for name in path_parameters or {}:
        if name in KNOWN and rng.random() < 0.5:
            path_parameters[name] = rng.choice(KNOWN[name])
            running = pathlib.Path(RUNNING)
            if context.operation.path.endswith("frame.png") and running.exists():
                path_parameters[name] = running.read_text()
    return path_parameters


@schemathesis.hook
def map_body(context, body):
    # bodies that are made up are never valid jobs: some are one, so that the answer to it is checked, too
    return JOB if context.operation.path == "/v1/check" and rng.random() < 0.2 else body
'''


@dataclass
class Round:
    """One daemon and one way to call it."""

    name: str
    # what the daemon asks for, and what is shown
    token: str | None
    shown: str | None


ROUNDS = [Round("open", None, None), Round("with its token", TOKEN, TOKEN), Round("token not shown", TOKEN, None)]


class Tidier(threading.Thread):
    """Keeps the daemon usable while it is called at random: a job runs, others are cancelled, stopped plates reset."""

    def __init__(self, daemon, folder):
        super().__init__(daemon=True)
        self.daemon_under_test, self.folder = daemon, folder
        self.over, self.keeps, self.began = threading.Event(), None, 0

    def run(self):
        while not self.over.wait(KEEP_TIDY_S):
            try:
                self.tidy()
            except (OSError, ValueError, DaemonFault) as fault:
                say(f"  tidying: {fault}")

    def tidy(self):
        daemon = self.daemon_under_test
        for plate in daemon.get("/v1/plates")["plates"]:
            if plate["state"] == "stopped":
                daemon.ask("POST", f"/v1/plates/{plate['name']}/reset", {"operator": "campaign", "reason": "called at random"})
            if plate["state"] in ("stopped", "paused"):
                daemon.ask("POST", f"/v1/plates/{plate['name']}/resume")
        for state in ("queued", "running"):
            for job in daemon.get(f"/v1/jobs?state={state}&limit=200")["jobs"]:
                if job["id"] != self.keeps:
                    daemon.ask("POST", f"/v1/jobs/{job['id']}/cancel")
        if self.keeps is None or daemon.get(f"/v1/jobs/{self.keeps}")["state"] in FINAL:
            answer = daemon.ask("POST", "/v1/jobs", plus_sign("upm-1"))
            if answer.status == 201:
                self.keeps, self.began = answer.json()["id"], self.began + 1
                (self.folder / RUNNING_FILE).write_text(self.keeps)
        # pictures are drawn only for a client that asked for them
        if self.keeps:
            daemon.ask("GET", f"/v1/jobs/{self.keeps}/frame.png")


def fuzz(daemon, round_, args, folder):
    """What schemathesis prints, and its exit status; -1 when it hangs."""
    ids = [daemon.submit(short_arrange("upm-2", seed), pace="max")["id"] for seed in range(1, 4)]
    for job_id in ids:
        daemon.wait_end(job_id, 60.0)
    (folder / "fuzz_hooks.py").write_text(HOOKS)
    tidier = Tidier(daemon, folder)
    tidier.start()
    environment = os.environ | {
        "SCHEMATHESIS_HOOKS": "fuzz_hooks",
        "PYTHONPATH": str(folder),
        "FUZZ_ID": ",".join(ids),
        "FUZZ_NAME": "upm-1,upm-2",
        "FUZZ_FILE": ",".join(set(re.findall(r"/assets/([\w.-]+)", daemon.ask("GET", "/").body.decode()))),
        "FUZZ_RUNNING": str(folder / RUNNING_FILE),
        "FUZZ_SEED": str(args.seed),
        "FUZZ_JOB": json.dumps(short_arrange("upm-2", 1)),
        "NO_COLOR": "1",
    }
    schema = folder / "openapi.json"
    schema.write_bytes(daemon.ask("GET", "/openapi.json").body)
    command = [
        str(pathlib.Path(sys.prefix) / "bin/schemathesis"), "run", str(schema), "--url", daemon.url,
        "--checks", ",".join(CHECKS), "--max-examples", str(args.examples), "--seed", str(args.seed),
        "--request-timeout", str(REQUEST_TIMEOUT_S), "--workers", "1", "--continue-on-failure", "--no-color",
        *(["--header", f"Authorization: Bearer {round_.shown}"] if round_.shown else []),
    ]  # fmt: skip
    log = folder / f"fuzz-{round_.name.replace(' ', '-')}.txt"
    try:
        with open(log, "wb") as out:
            status = subprocess.run(command, stdout=out, stderr=subprocess.STDOUT, env=environment, cwd=folder, timeout=args.limit).returncode
    except subprocess.TimeoutExpired:
        status = -1
    tidier.over.set()
    tidier.join()
    return log.read_text(errors="replace"), status, tidier.began


def summary(text):
    """Cases, operations and failures as schemathesis counts them."""
    cases = re.search(r"([\d,]+) generated", text)
    tested = re.search(r"Tested: (\d+)", text)
    failed = re.search(r"([\d,]+) found (\d+) unique failures", text)
    count = lambda found: found[1] if found else "?"
    return f"{count(cases)} cases, {count(tested)} operations, {failed[2] if failed else 0} failures"


def main():
    parser = parser_of(__doc__)
    parser.add_argument("--examples", type=int, default=100, help="cases of each operation and phase at most")
    parser.add_argument("--limit", type=float, default=3600.0, help="longest time of a round, s; beyond it is a hang")
    parser.add_argument("--rounds", type=int, default=len(ROUNDS), help="only the first so many of the three")
    parser.add_argument("--venv", type=pathlib.Path, default=ROOT / "target/daemon-fuzz")
    args = parser.parse_args()
    enter_venv(args.venv, ["schemathesis==4.32.5"], ["schemathesis"])
    bars = Bars()
    with work_folder(args.keep) as folder:
        (folder / "token").write_text(TOKEN + "\n")
        (folder / "token").chmod(0o600)
        for round_ in ROUNDS[: args.rounds]:
            say(f"{round_.name}")
            more = {"token_file": str(folder / "token")} if round_.token else {}
            data = folder / f"data-{round_.name.replace(' ', '-')}"
            config = write_config(folder, {"upm-1": "upm-1", "upm-2": "upm-2"}, default_plate="upm-2", **more)
            with Daemon(args.upm, folder, config, data=data, token=round_.token).start() as daemon:
                text, status, began = fuzz(daemon, round_, args, folder)
                bars.hold(f"{round_.name}: schemathesis", "passes", f"{summary(text)}, exit {status}", status == 0)
                if status:
                    print(text)
                health = daemon.ask("GET", "/healthz")
                bars.hold(f"{round_.name}: /healthz afterwards", 200, health.status, health.status == 200)
                bars.tell(f"{round_.name}: jobs that ran beside it", began)
    sys.exit(bars.close())


if __name__ == "__main__":
    main()
