"""`--solver direct`: a session without Phase 1, from its announced cost to its report."""

from __future__ import annotations

from pathlib import Path

import pytest

import adaptsim
from adaptsim_cli.commands import app

TASK = """
import adaptsim
import numpy as np


@adaptsim.task(
    parameters={"mu": (0.1, 0.3), "mass": (0.2, 0.5, "kg")},
    context={"goal": (0.2, 0.6, "m")},
    action={"force": (2.0, 8.0, "N")},
    state={"x": (0.0, 2.0, "m")},
    duration=1.0,
    reward=lambda end, context: 1 - abs(end.x - context.goal) / 0.2,
    worlds={"slick": dict(mu=0.12, mass=0.42)},
)
def disc(p, action):
    times = np.linspace(0.0, 1.0, 11)
    braking = 9.81 * p.mu
    speed = 0.2 * max(action.force / p.mass - braking, 0.0)
    sliding = np.minimum(times, speed / braking)
    return times, (speed * sliding - 0.5 * braking * sliding**2)[:, None]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("ADAPTSIM_WORKERS", "1")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "disc.py").write_text(TASK, encoding="utf-8")
    return tmp_path


def shown(capsys: pytest.CaptureFixture[str]) -> str:
    both = capsys.readouterr()
    return " ".join((both.out + both.err).split())


def kept(folder: Path) -> set[str]:
    return {path.name for path in (folder / "home").rglob("rollouts/*.npz")}


@pytest.mark.long
def test_a_session_without_phase_1_says_its_cost_keeps_its_rollouts_and_goes_on(folder, capsys):
    begin = ["run-iteration", "--task", "disc.py", "--world", "slick", "--solver", "direct", "--yes"]
    assert app.run(begin) == 0, shown(capsys)
    words = shown(capsys)
    assert "No Phase 1: this session simulates up to 162 rollouts before its first trial, 172 after the first" in words
    assert "Truth, range and belief" in words
    assert app.run(["run-iteration", "--session", "disc-slick-direct", "--yes"]) == 0, shown(capsys)
    assert "No Phase 1" not in shown(capsys)
    session = adaptsim.open_session("disc-slick-direct")
    rewards = [trial.reward for trial in session.trials]
    assert min(rewards[4:]) > 0.9
    rollouts = kept(folder)
    home = folder / "home/data/sessions/disc-slick-direct"
    (home / "solver").rename(home / "naf")  # as earlier versions named it
    low, high = session.posterior().quantiles((0.05, 0.95))
    assert (high - low < [0.02, 0.03]).all()
    best = session.best_policy()
    assert best.predict([0.4])[0] > 0.95
    assert app.run(["report", "disc-slick-direct"]) == 0
    assert kept(folder) == rollouts, "the report, the posterior and the policy need no further rollout"
    assert not (home / "solver").exists()
    (folder / "disc.py").write_text(TASK.replace("0.2 * max", "0.25 * max"), encoding="utf-8")
    capsys.readouterr()
    assert app.run(["run-iteration", "--session", "disc-slick-direct", "--yes"]) != 0
    assert "the physics or a range of the task has changed since session 'disc-slick-direct'" in shown(capsys)


def test_direct_goes_with_direct_alone(folder, capsys):
    begin = ["run-iteration", "--task", "disc.py", "--yes", "--solver", "direct"]
    assert app.run([*begin, "--method", "udr"]) == 2
    assert "--method udr: the direct solver and the direct method need each other" in shown(capsys)
    assert app.run([*begin, "--start-from", "another"]) == 2
    assert "--start-from rests on a checkpoint, and the direct solver has none" in shown(capsys)
    assert app.run(["pretrain", "--task", "disc.py", "--solver", "direct"]) == 2
    assert "--solver direct: choose one of emulator, naf" in shown(capsys)
