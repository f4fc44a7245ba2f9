#!/usr/bin/env python3
"""Campaigns by engines, each the real thing on this machine, with a worker killed in the middle.

usage: engines.py [--upm target/debug/upm] [--venv target/engines] [--wheel upm-….whl]

Runs the shards of one campaign by Slurm (Debian's slurmctld with three slurmd, one of them killed and its task requeued), by
HyperQueue (server and workers of its wheel, one killed) and, with the wheel of the module, by Dask through `upm.campaign` (one
worker killed). Each summary has to have the bytes of the one that a single process makes, and each run one line.

Exit status 1 when one differs. An engine that is not there is skipped by name.
"""
import contextlib
import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

from common import ROOT, enter_venv, output_of, parser_of

SHARDS = 12
LIMIT_S = 300.0
SLURM_CONF = """ClusterName=upm
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/none
CredType=cred/none
MpiDefault=none
ProctrackType=proctrack/pgid
ReturnToService=2
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmdSpoolDir={folder}/spool-%n
StateSaveLocation={folder}/state
SlurmctldPort=26817
SwitchType=switch/none
TaskPlugin=task/none
SelectType=select/cons_tres
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
JobAcctGatherType=jobacct_gather/none
SlurmctldTimeout=30
SlurmdTimeout=5
KillWait=2
SchedulerParameters=sched_interval=2,batch_sched_delay=0
SlurmdParameters=config_overrides
NodeName=n[1-3] NodeHostName={host} NodeAddr=127.0.0.1 Port=[27001-27003] CPUs=1 RealMemory=500 State=UNKNOWN
PartitionName=p Nodes=n[1-3] Default=YES MaxTime=INFINITE State=UP
"""
HQ_WORKER = """
import os, sys, tempfile, time
from hyperqueue import LocalCluster
from hyperqueue.cluster import WorkerConfig
own = tempfile.mkdtemp()
cluster = LocalCluster(server_dir=own)
os.remove(own + "/hq-current")
os.symlink(os.path.realpath(sys.argv[1] + "/hq-current"), own + "/hq-current")
cluster.start_worker(WorkerConfig(cores=1))
time.sleep(600)
"""


def until(holds, what):
    """Waits until `holds()`."""
    begin = time.monotonic()
    while not holds():
        if time.monotonic() - begin > LIMIT_S:
            sys.exit(f"engines.py: not within {LIMIT_S:.0f} s: {what}")
        time.sleep(0.1)


def lines(out):
    return [json.loads(line) for path in sorted(out.glob("shard-*.jsonl")) for line in path.read_text().splitlines()]


def killed(process):
    """Ends a process and all that it has started, at once."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def started(*command, **options):
    return subprocess.Popen(list(map(str, command)), process_group=0, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **options)


def by_slurm(upm, file, out, folder):
    (folder / "state").mkdir()
    host, conf = socket.gethostname(), folder / "slurm.conf"
    conf.write_text(SLURM_CONF.format(host=host, folder=folder))
    environment = os.environ | {"SLURM_CONF": str(conf)}
    nodes = {name: started("slurmd", "-D", "-N", name, env=environment) for name in ("n1", "n2", "n3")}
    control = started("slurmctld", "-D", "-c", env=environment)
    slurm = lambda *command: subprocess.run(command, env=environment, capture_output=True, text=True).stdout
    try:
        until(lambda: slurm("sinfo", "-h", "-t", "idle", "-o", "%D").strip() == "3", "three idle nodes")
        wrap = f"{upm} campaign {file} --out {out} --shard $SLURM_ARRAY_TASK_ID/{SHARDS} --jobs 1 --quiet"
        job = slurm("sbatch", "--parsable", f"--array=1-{SHARDS}", "--requeue", "--output=/dev/null", f"--wrap={wrap}").strip()
        until(lambda: len(lines(out)) > 5 and "n2" in slurm("squeue", "-h", "-t", "R", "-o", "%N"), "runs on n2")
        steps = slurm("squeue", "-h", "-w", "n2", "-o", "%i").split()
        killed(nodes["n2"])
        # what the node ran goes with it, first of all what would tell the controller of its end
        for name in (b"slurmstepd", b""):
            for process in pathlib.Path("/proc").glob("[0-9]*"):
                with contextlib.suppress(OSError):
                    runs_on_n2 = b"SLURMD_NODENAME=n2\0" in (process / "environ").read_bytes()
                    parent = pathlib.Path("/proc", (process / "stat").read_text().rsplit(") ")[1].split()[1])
                    ended = parent if name else process
                    if runs_on_n2 and (not name or (parent / "comm").read_bytes().strip() == name):
                        os.kill(int(ended.name), signal.SIGKILL)
        print(f"slurm: killed n2 with task {' '.join(steps)}", flush=True)
        until(lambda: "n2" in slurm("sinfo", "-h", "-N", "-t", "down", "-o", "%N"), "n2 down")
        nodes["n2"] = started("slurmd", "-D", "-N", "n2", env=environment)
        # it would wait for two minutes
        until(lambda: slurm("squeue", "-h", "-j", job, "-t", "PD"), "the lost task in the queue")
        slurm("scontrol", "update", f"JobId={steps[0]}", "StartTime=now")
        until(lambda: not slurm("squeue", "-h", "-j", job).strip(), "an empty queue")
    finally:
        for process in (*nodes.values(), control):
            killed(process)


def by_hyperqueue(upm, file, out, folder):
    from hyperqueue import Job, LocalCluster

    cluster = LocalCluster(server_dir=str(folder))
    workers = [started(sys.executable, "-c", HQ_WORKER, folder) for _ in range(3)]
    try:
        job = Job()
        for shard in range(1, SHARDS + 1):
            job.program([str(upm), "campaign", str(file), "--out", str(out), "--shard", f"{shard}/{SHARDS}", "--jobs", "1", "--quiet"])
        client = cluster.client()
        submitted = client.submit(job)
        until(lambda: len(lines(out)) > 5, "the first runs")
        killed(workers[1])
        print("hyperqueue: killed a worker", flush=True)
        client.wait_for_jobs([submitted])
    finally:
        for worker in workers:
            killed(worker)
        cluster.stop()


def by_dask(file, out):
    import upm
    from distributed import Client

    port = 38786
    address = f"tcp://127.0.0.1:{port}"
    dask = pathlib.Path(sys.prefix) / "bin/dask"
    scheduler = started(dask, "scheduler", "--port", port, "--no-dashboard", "--host", "127.0.0.1")
    workers = [started(dask, "worker", address, "--nthreads", 1, "--no-dashboard", "--no-nanny") for _ in range(3)]
    try:
        with Client(address) as client:
            client.wait_for_workers(3)
            future = client.get_executor(pure=False)
            killer = subprocess.Popen(["sh", "-c", f"while ! grep -qs run {out}/*.jsonl; do sleep 0.1; done; kill -9 {workers[1].pid}"])
            upm.campaign(file, out=out, executor=future, shards=SHARDS)
            killer.wait()
    finally:
        for process in (*workers, scheduler):
            killed(process)


def main():
    args = parser_of(__doc__, venv=str(ROOT / "target/engines"), wheel="").parse_args()
    wheel = [args.wheel] if args.wheel else []
    enter_venv(args.venv, ["hyperqueue", "distributed", *wheel], ["hyperqueue", "distributed"] + ["upm"] * bool(wheel))
    upm, good = pathlib.Path(args.upm).resolve(), True
    with tempfile.TemporaryDirectory(prefix="upm-engines-") as scratch:
        scratch = pathlib.Path(scratch)
        text = json.loads((ROOT / "configs/campaigns/planners.json").read_text()) | {"seeds": "1..6"}
        text["job"]["parts"][0]["count"] = {"$each": [2, 4, 8]}
        text["job"]["rig"] = str(ROOT / "configs/rigs/upm-2.json")
        file = scratch / "campaign.json"
        file.write_text(json.dumps(text))
        command = [upm, "campaign", file, "--out", scratch / "alone", "--quiet"]
        output_of(command, (0, 1))
        expected = json.loads((scratch / "alone/summary.json").read_text())
        engines = {"hyperqueue": by_hyperqueue, "slurm": by_slurm}
        for name, by in engines.items():
            if name == "slurm" and not all(map(shutil.which, ("slurmctld", "slurmd", "sbatch"))):
                print("slurm: skipped, it is not installed")
                continue
            out, folder = scratch / name, scratch / f"{name}-state"
            folder.mkdir()
            by(upm, file, out, folder)
            output_of([upm, "campaign", "merge", out, "--expect", expected["runs"], "--quiet"], (0, 1))
            good &= same(name, expected, out)
        if args.wheel:
            import upm as module

            expected = module.campaign(file, out=scratch / "module")
            by_dask(file, scratch / "dask")
            good &= same("dask", expected, scratch / "dask")
    sys.exit(0 if good else 1)


def same(name, expected, out):
    """True if the summary is the one of a single process, shards aside, and each run has one line."""
    found, runs = json.loads((out / "summary.json").read_text()), [line["run"] for line in lines(out)]
    is_same = {**found, "shards": 0} == {**expected, "shards": 0} and sorted(runs) == list(range(1, expected["runs"] + 1))
    print(f"{name}: {len(runs)} lines of {expected['runs']} runs, summary {'equal' if is_same else 'NOT EQUAL'}", flush=True)
    return is_same


if __name__ == "__main__":
    main()
