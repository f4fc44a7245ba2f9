"""The learning environments from outside: Gymnasium's own checks, determinism, our planner, hostile actions."""

import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import upm
import upm.gym

ACTIONS = ["motion", "pulse", "steps"]


def many(number, task="Arrange", **how):
    return gymnasium.make_vec(f"upm/{task}-v0", number, vectorization_mode="vector_entry_point", **how)


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("task", ["Arrange", "Sort", "Stream"])
def test_gymnasium_finds_nothing(task, action):
    plate = gymnasium.make(f"upm.gym:upm/{task}-v0", action=action, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(plate.unwrapped)
        plates = many(3, task, action=action)
        seen, _ = plates.reset(seed=1)
        for _ in range(3):
            assert seen in plates.observation_space
            seen, rewards, terminated, truncated, info = plates.step(plates.action_space.sample())
            assert rewards.shape == terminated.shape == truncated.shape == info["is_success"].shape == (3,)


def test_equal_seeds_give_equal_journals_alone_and_among_many():
    def hashes(number, threads):
        plates = many(number, parts=2, action="steps", threads=threads)
        plates.reset(seed=5)
        for _ in range(12):
            plates.step(plates.expert())
        return plates.journal_hashes()

    among = hashes(64, 2)
    assert hashes(1, 1) == among[:1] and hashes(3, 1) == among[:3] and len(set(among)) == 64
    plate = gymnasium.make("upm/Arrange-v0", parts=2, action="steps").unwrapped
    plate.reset(seed=5)
    ended = False
    for _ in range(12):
        # the vector's step after an end begins a new episode
        if ended:
            plate.reset()
            ended = False
        else:
            ended = any(plate.step(plate.expert())[2:4])
    assert plate.journal_hash() == among[0]


def test_journals_and_data_sets_are_equal_on_other_processors(tmp_path):
    others = [([], {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"})]
    if shutil.which("qemu-x86_64"):
        others.append((["qemu-x86_64", "-cpu", "Nehalem"], {}))

    def said(by, env, *command):
        return subprocess.check_output([*by, sys.executable, *command], env=os.environ | env, text=True)

    play = Path(__file__).with_name("played.py")
    here = said([], {}, play, tmp_path / "here")
    assert len(here.split()) == 10
    for number, (by, env) in enumerate(others):
        assert said(by, env, play, tmp_path / str(number)) == here
        said(by, env, "-m", "upm", "verify", tmp_path / "here" / "set")


def test_pictures_show_parts_and_targets_and_change_no_journal():
    alone, seen = (gymnasium.make("upm/Arrange-v0", parts=2, action="steps", render_mode=mode) for mode in (None, "rgb_array"))
    seen = gymnasium.wrappers.AddRenderObservation(seen, render_only=False, render_key="pixels", obs_key="state")
    (state, _), (both, _) = alone.reset(seed=3), seen.reset(seed=3)
    for _ in range(20):
        assert (both["state"] == state).all() and both["pixels"].shape == (1024, 1280, 3)
        red = (both["pixels"] == (255, 0, 0)).all(axis=2)
        assert 117 <= red.sum() <= 234
        action = alone.unwrapped.expert()
        state, *_, ended, _, _ = alone.step(action)
        both = seen.step(action)[0]
        if ended:
            break
    # both coins are home: beside each cross is dark metal
    beside = [both["pixels"][int(y) + 5, int(x) + 5, 0] for x, y in seen.unwrapped._plates.picture(0)[1]]
    assert ended and alone.unwrapped.journal_hash() == seen.unwrapped.journal_hash() and max(beside) < 60
    plates = many(2, parts=1, render_mode="rgb_array")
    plates.reset(seed=3)
    assert [picture.shape for picture in plates.render()] == [(1024, 1280, 3)] * 2


@pytest.mark.parametrize(("task", "action", "parts"), [("Arrange", "steps", 3), ("Arrange", "motion", 4),
                                                      ("Arrange", "pulse", 2), ("Sort", "motion", 6)])
def test_expert_brings_all_parts_home(task, action, parts):
    for seed in range(3):
        plate = gymnasium.make(f"upm/{task}-v0", action=action, parts=parts)
        seen, info = plate.reset(seed=seed)
        ended = False
        while not ended:
            seen, reward, terminated, truncated, info = plate.step(plate.unwrapped.expert(seen))
            ended = terminated or truncated
        assert info["is_success"] and terminated and reward > 0.9, info


def test_stream_gives_new_places_until_its_time():
    plates = many(2, "Stream", parts=2, action="steps", plate_time_s=20)
    plates.reset(seed=1)
    arrived = 0
    while True:
        _, rewards, terminated, truncated, info = plates.step(plates.expert())
        arrived += info["arrived"].sum()
        if truncated.all():
            break
        assert not terminated.any()
    assert arrived >= 8


def test_what_cannot_be_played_is_refused():
    plate = gymnasium.make("upm/Arrange-v0").unwrapped
    plate.reset(seed=1)
    with pytest.raises(upm.UpmError, match=r"action: \[\d+\]: expected from -1 to 1, found NaN"):
        plate.step(np.full(plate.action_space.shape, np.nan))
    with pytest.raises(ValueError):
        plate.step(np.zeros(3))
    with pytest.raises(upm.UpmError, match="action: expected one of motion, pulse, steps"):
        gymnasium.make("upm/Arrange-v0", action="push")
    with pytest.raises(upm.UpmError, match="count: expected"):
        gymnasium.make("upm/Arrange-v0", parts=0)
    assert plate.step(np.zeros(plate.action_space.shape))[0].shape == (24,)
