"""The module from outside: what the command line does, refusals, a caller's own task, planner and rig."""

import concurrent.futures
import json
import multiprocessing
import runpy
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import upm

ROOT = Path(__file__).parents[3]


def journal(report):
    return (report.folder / "journal.jsonl").read_bytes()


def test_run_is_that_of_the_command_line(tmp_path):
    report = upm.run("arrange-4", seed=3, out=tmp_path / "module")
    job = upm.shipped() / "configs/arrange-4.json"
    command = [sys.executable, "-m", "upm", "run", job, "--seed", "3", "--out", tmp_path / "command", "--quiet"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    (folder,) = (tmp_path / "command").iterdir()
    assert report and journal(report) == (folder / "journal.jsonl").read_bytes()
    positions = report.tables["positions"]
    assert {len(column) for column in positions.values()} == {len(positions["part"])}
    assert positions["result_x_mm"].dtype == float and set(positions["id"]) == {f"penny-{n}" for n in range(1, 5)}
    assert list(report.frame("pulses")["probe"])[0] in (True, False)


def test_jobs_are_read_as_files_are(tmp_path):
    job = upm.Job("arrange-2", name="own", seed=7)
    assert (job.name, job.seed, job.to_dict()["name"]) == ("own", 7, "own")
    made = upm.Job(rig="rigs/upm-2.json", name="two", parts=[{"kind": "penny", "position_mm": [0, 0]}],
                   task={"type": "arrange", "targets_mm": [[6, 3]]})
    assert upm.run(made, camera="positions", out=tmp_path)
    with pytest.raises(upm.UpmError, match="^job: parts: expected .*\njob: rig: expected ") as refused:
        upm.Job({"name": "x"})
    assert isinstance(refused.value, ValueError)
    with pytest.raises(upm.UpmError, match="planner: expected one of auto, .* found \"fast\""):
        upm.Job("arrange-2", planner="fast")
    with pytest.raises(upm.UpmError, match="^--faults: "):
        upm.run("arrange-2", faults=["coil:dead"], out=tmp_path)
    with pytest.raises(ValueError, match="camera: expected pixels or positions"):
        upm.run("arrange-2", camera="none", out=tmp_path)


def test_pictures_are_arrays_or_files(tmp_path):
    report = upm.run("arrange-8", camera="positions", out=tmp_path)
    assert report
    plate = upm.simulated_plate("arrange-8")
    image, number, at_s = plate.capture()
    assert image.dtype == np.uint8 and image.ndim == 2 and number >= 1 and at_s > 0
    found = upm.locate(image, plate_side_mm=304.8, kinds="penny")
    assert len(found["parts"]) == 8
    with pytest.raises(upm.UpmError, match="^image: "):
        upm.locate(np.zeros((200, 300), np.uint8))
    for bad in (np.zeros((2, 2, 2), np.uint8), np.zeros((4, 4)), np.zeros((0, 4), np.uint8)):
        with pytest.raises(ValueError, match="^image: expected"):
            upm.locate(bad)
    with pytest.raises(upm.UpmError, match="cannot read"):
        upm.locate(tmp_path / "none.png")


def test_experiments_and_libraries():
    tracks = upm.simulate(upm.shipped() / "configs/simulate/rotation.json")
    assert tracks["t_s"] and tracks["parts"]
    library = upm.Library(upm.shipped() / "assets/libraries/upm-2.json")
    assert library.amplitudes.shape == (410, 4) and library.centers_mm.shape == (410, 2)
    # the plate's velocity at a centre of rotation is zero
    turning = np.isfinite(library.centers_mm).all(1)
    x, y = library.centers_mm[turning].T
    spins = library.spins_radps[turning]
    at_center = library.velocities_mmps[turning] + np.stack([-spins * y, spins * x], axis=1)
    assert np.abs(at_center).max() < 1e-6


def test_own_task_ends_the_run_by_none(tmp_path):
    def ring(at_s, places_mm):
        angles = 2 * np.pi * np.arange(len(places_mm)) / len(places_mm)
        targets_mm = 60 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return None if np.abs(places_mm - targets_mm).max() < 0.5 else targets_mm

    report = upm.run("arrange-4", task=ring, camera="positions", out=tmp_path)
    assert report.outcome == "completed" and "task is the caller's own" in report.document["warnings"][0]
    for bad, says in ((lambda *_: np.full((4, 2), np.nan), "NaN"), (lambda *_: [1, 2], r"shape \(4, 2\)")):
        with pytest.raises(ValueError, match=f"targets: expected .*{says}"):
            upm.run("arrange-4", task=bad, camera="positions", out=tmp_path)
    with pytest.raises(ZeroDivisionError):
        upm.run("arrange-4", task=lambda *_: 1 / 0, camera="positions", out=tmp_path)


def test_own_planner_plans_in_the_loop(tmp_path):
    def one_coin(places_mm, targets_mm, library):
        """The translation or rotation that points best to the target, as far as it is."""
        step = (targets_mm - places_mm)[0]
        (x, y), spins = places_mm[0], library.spins_radps
        flow = library.velocities_mmps + np.stack([-spins * y, spins * x], axis=1)
        speed = np.linalg.norm(flow, axis=1)
        along = flow @ step / speed
        entry = int(np.abs(along).argmax())
        distance = np.sign(along[entry]) * np.clip(np.linalg.norm(step), 0.6, 5)
        return [upm.Rotation(entry, distance)]

    job = upm.Job("arrange-2", parts=[{"kind": "penny", "position_mm": [0, 0]}],
                  task={"type": "arrange", "targets_mm": [[20, 10]]}, tolerance_mm=1.0)
    report = upm.run(job, planner=one_coin, camera="positions", out=tmp_path)
    assert report.outcome == "completed", report
    with pytest.raises(ValueError, match="entry: expected one of 0 to 409, found 410"):
        upm.run(job, planner=lambda *_: [upm.Rotation(410, 5)], camera="positions", out=tmp_path)
    strong = upm.Motion(np.full((3, 2, 3), 1e5), 0.1)
    report = upm.run(job, planner=lambda *_: [strong], camera="positions", out=tmp_path)
    assert report.outcome == "failed" and "the rig allows" in report.reason
    with pytest.raises(ValueError, match=r"motion: expected shape \(n, 2, 3\)"):
        upm.run(job, planner=lambda *_: [upm.Motion(np.zeros((1, 1, 1)), 0.1)], camera="positions", out=tmp_path)


# the simulated plate behind a rig of one's own
Through = runpy.run_path(str(ROOT / "examples/python/own_rig.py"))["MyRig"]


def test_own_rig_is_driven_by_samples(tmp_path):
    report = upm.run("arrange-4-cor", seed=5, rig=Through("arrange-4-cor", 5), out=tmp_path)
    assert report.outcome == "completed" and report.plate_time_s > 1
    assert journal(report) == journal(upm.run("arrange-4-cor", seed=5, out=tmp_path))

    class Broken(Through):
        def capture(self):
            if self.plate.now_s() > 0.3:
                raise OSError("the cable is out")
            return super().capture()

    with pytest.raises(OSError, match="the cable is out"):
        upm.run("arrange-4-cor", rig=Broken("arrange-4-cor", 1), out=tmp_path)
    with pytest.raises(upm.UpmError, match="faults: expected none on a rig of the caller's"):
        upm.run("arrange-4-cor", rig=Through("arrange-4-cor", 1), faults=["coil1:dead@1"], out=tmp_path)


def test_ctrl_c_ends_a_run_in_good_order_and_other_threads_go_on(tmp_path):
    ticks, ended = [], threading.Event()

    def tick():
        while not ended.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.01)

    thread = threading.Thread(target=tick)
    thread.start()
    threading.Timer(1.0, signal.raise_signal, [signal.SIGINT]).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            upm.run("plus-sign-endless", out=tmp_path)
    finally:
        ended.set()
        thread.join()
    assert len(ticks) > 30
    (folder,) = tmp_path.iterdir()
    assert upm.Report(folder).outcome == "cancelled"


def test_ten_thousand_refusals_leak_nothing():
    def resident_kb():
        with open("/proc/self/status", encoding="utf-8") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))

    def refuse(count):
        for _ in range(count):
            with pytest.raises(upm.UpmError):
                upm.Job({"name": "x"})

    refuse(1000)
    before = resident_kb()
    refuse(9000)
    assert resident_kb() - before < 8_000


@pytest.mark.parametrize("page", ["README.md", "docs/python.md"])
def test_lines_of_the_pages_run_as_typed(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = (ROOT / page).read_text(encoding="utf-8").split("```python\n")[1:]
    assert blocks
    for block in blocks:
        exec(block.split("```")[0], {})


@pytest.mark.parametrize("notebook", sorted((ROOT / "examples/notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_run(notebook, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    names = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            # CI learns for a moment only
            exec("".join(cell["source"]).replace("train(150", "train(5"), names)


@pytest.mark.parametrize("example", sorted((ROOT / "examples/python").glob("*.py")), ids=lambda path: path.stem)
def test_examples_complete(example, tmp_path):
    few = {"stream": ["20"], "train_baseline": ["5"]}
    done = subprocess.run([sys.executable, example, *few.get(example.stem, [])], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and "completed" in done.stdout, done.stderr


def test_ctrl_c_ends_the_command_in_good_order(tmp_path):
    job = upm.shipped() / "configs/plus-sign-endless.json"
    command = [sys.executable, "-m", "upm", "run", job, "--out", tmp_path, "--quiet"]
    heard = lambda: signal.signal(signal.SIGINT, signal.default_int_handler)
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, preexec_fn=heard)
    time.sleep(2)
    run.send_signal(signal.SIGINT)
    assert run.wait(timeout=20) == 130


def test_campaign_is_that_of_the_command_line_by_any_executor(tmp_path):
    job = {"rig": str(upm.shipped() / "configs/rigs/upm-2.json"), "parts": [{"kind": "penny"}]}
    job |= {"task": {"type": "arrange", "targets_mm": [[0, 0]]}, "planner": {"$each": ["moving_field", "synthesized_field"]}}
    file = tmp_path / "middle.json"
    file.write_text(json.dumps({"name": "middle", "seeds": "1..6", "job": job}))
    subprocess.run(["upm", "campaign", file, "--out", tmp_path / "alone", "--quiet"], check=True)
    summary = json.loads((tmp_path / "alone/summary.json").read_text())
    assert upm.campaign(file, out=tmp_path / "here") == summary
    # the processes of a pool that forks would share the threads of this one
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(2, context) as executor:
        assert upm.campaign(file, out=tmp_path / "pool", executor=executor) == summary
    assert (tmp_path / "pool/summary.json").read_bytes() == (tmp_path / "alone/summary.json").read_bytes()
    file.write_text(json.dumps({"name": "middle", "seeds": "6..1", "job": job}))
    with pytest.raises(upm.UpmError, match="seeds: expected FIRST..LAST"):
        upm.campaign(file, out=tmp_path / "never")
