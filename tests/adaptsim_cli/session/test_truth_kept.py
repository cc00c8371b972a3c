"""The rollouts of UDR behind a report are simulated once, and kept by checkpoint and world."""

from __future__ import annotations

from pathlib import Path

import pytest

from adaptsim_cli.show import truth
from sim.adaptation.checkpoint import load_checkpoint
from sim.lab.world import load_world
from sim.rollouts import run
from sim.tasks import get_task


def test_another_process_simulates_none_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    task = get_task("pendulum")
    checkpoint, world = load_checkpoint(task), load_world("wd", task)
    rewards = truth._udr_rewards.__wrapped__(checkpoint, world)
    assert len(list((tmp_path / "data" / "truth").glob("*.npz"))) == 1
    monkeypatch.setattr(run, "run_many", lambda *a: pytest.fail("simulated again"))
    assert truth._udr_rewards.__wrapped__(checkpoint, world) == rewards
    monkeypatch.undo()
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    truth._udr_rewards.__wrapped__(checkpoint, load_world("ood-1", task))
    assert len(list((tmp_path / "data" / "truth").glob("*.npz"))) == 2
