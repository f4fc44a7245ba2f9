"""Plays a run and episodes of every kind of action, and prints their journals' hashes; leaves the run as a data set.

usage: played.py FOLDER
"""

import hashlib
import subprocess
import sys
from pathlib import Path

import gymnasium

import upm
import upm.gym  # registers the environments


def main(folder):
    report = upm.run("arrange-2", seed=2, camera="positions", out=folder / "run")
    print(hashlib.sha256((report.folder / "journal.jsonl").read_bytes()).hexdigest())
    for action in ("motion", "pulse", "steps"):
        plates = gymnasium.make_vec("upm/Arrange-v0", 2, vectorization_mode="vector_entry_point", parts=2, action=action)
        plates.reset(seed=4)
        for _ in range(4):
            plates.step(plates.expert())
        print(action, *plates.journal_hashes())
    command = [sys.executable, "-m", "upm", "export", report.folder, "--lerobot", folder / "set"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
