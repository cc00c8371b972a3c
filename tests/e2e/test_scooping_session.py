"""Whole sessions of scooping on the simulated lab with the shipped checkpoint."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from lab_session import WORLD, digest, run, run_and_kill, steady


@pytest.fixture
def world(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(WORLD)
    return path


@pytest.mark.long
def test_one_iteration_ends_in_the_documented_json_and_a_report(tmp_path: Path, world: Path) -> None:
    done = run(tmp_path / "home", world)
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    summary = json.loads(line)
    assert (summary["task"], summary["hw"], summary["seed"], summary["iteration"]) == ("scooping", "fake", 0, 1)
    assert [len(particle["trials"]) for particle in summary["particles"]] == [2, 2]
    for particle in summary["particles"]:
        assert list(particle["params"]) == ["mu", "e", "g", "h"]
        for trial in particle["trials"]:
            assert len(trial["observation"]) == 16
            assert 0.0 <= trial["reward"] <= 1.0
            assert trial["outcome"] in ("on_blade", "on_table", "lost")
    assert "<svg" in (tmp_path / "home/data/sessions/s/report.html").read_text()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_session(tmp_path: Path, world: Path) -> None:
    once, again = (run(tmp_path / home, world, "--iterations", "2") for home in ("a", "b"))
    assert once.returncode == again.returncode == 0, once.stderr + again.stderr
    lines = zip(once.stdout.splitlines(), again.stdout.splitlines(), strict=True)
    assert all(steady(json.loads(a)) == steady(json.loads(b)) for a, b in lines)


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "code"), [("camera_timeout", 6), ("arm_reflex", 5), ("pedal_release", 7)])
def test_a_fault_has_its_exit_code_and_costs_one_attempt(fault: str, code: int, tmp_path: Path, world: Path) -> None:
    world.write_text(f"{WORLD}[faults]\n{fault} = [2]\n")
    failed = run(tmp_path / "home", world)
    assert failed.returncode == code, failed.stderr
    assert failed.stderr.count("Error:") == 1
    assert "Traceback" not in failed.stderr
    assert failed.stdout == ""
    resumed = run(tmp_path / "home", world)
    assert resumed.returncode == 0, resumed.stderr
    folder = tmp_path / "home/data/sessions/s/iteration-01"
    assert (folder / "trial-002-attempt-2").is_dir()
    assert (folder / "trial-001-attempt-1").is_dir()


@pytest.mark.slow
def test_killed_at_twenty_random_moments_every_session_comes_to_the_same_end(tmp_path: Path, world: Path) -> None:
    began = time.monotonic()
    whole = run(tmp_path / "whole", world)
    took_s = time.monotonic() - began
    assert whole.returncode == 0, whole.stderr
    different = []
    for index, share in enumerate(np.random.default_rng(0).uniform(0.05, 1.0, 20)):
        home = tmp_path / f"killed-{index}"
        killed = run_and_kill(home, world, share * took_s)
        if killed:
            resumed = run(home, world)
            assert resumed.returncode == 0, resumed.stderr
        if digest(home) != digest(tmp_path / "whole"):
            different.append((index, share))
    assert different == []
