"""The example of the page on trained policies: PPO of stable-baselines3, with a tiny budget."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sim.adaptation.checkpoint import load_checkpoint
from sim.research.pretraining.budget import OptionalStages, PretrainBudget
from sim.research.pretraining.pipeline import pretrain
from sim.rollouts.executors import serial_executor
from sim.tasks import task_of_file

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "trained-policies.md"


@pytest.mark.slow
def test_ppo_trains_a_library_and_its_policies_come_back(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    found = re.search(r"<!-- file sb3_task.py -->\n```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert found is not None
    file = tmp_path / "sb3_task.py"
    file.write_text(found.group(1).replace("steps=20_000", "steps=256").replace("policies=4", "policies=2"))
    task = task_of_file(str(file))
    stages = OptionalStages(policies=False, evaluation=False)
    with serial_executor() as crew:
        path = pretrain(task, tmp_path / "p", PretrainBudget.small(task), 0, crew, lambda *at: None, stages=stages)
    solver = load_checkpoint(task, str(path)).solver
    assert solver.listed.shape == (2, 2)  # type: ignore[attr-defined]
    track = solver.task.simulate(task.parameters.middle, np.zeros(0), solver.listed[0], np.zeros(0))  # type: ignore[attr-defined]
    assert 0.0 <= solver.task.score(track, np.zeros(0)) <= 1.0
    assert (path / "policies" / "everywhere" / "policy.safetensors").exists()
