"""The scripts of `benchmarks/own_simulator.py`, as a student would write them: they fit trajectories, then search."""

from __future__ import annotations

from pathlib import Path

import fitting_scripts
import numpy as np
import own_simulator
import pytest
from kept import Kept

from sim.adaptation.method import Particle, ParticleTrials, trials_of_rows
from sim.tasks import task_of_file
from sim.tasks.task import Task

FILE = """
import adaptsim


@adaptsim.task(
    parameters={"mu": (0.1, 0.5)},
    context={"goal": (0.5, 1.5, "m")},
    action={"push": (0.2, 1.0)},
    state={"x": (0.0, 6.0, "m")},
    duration=1.0,
    moments=2,
    reward=lambda end, context: 1 - abs(end.x - context.goal) / 0.5,
)
def hit(p, context, action):
    return [0.0, 1.0], [0.0, 0.3 * action.push / p.mu + 0.1 * context.goal]
"""


@pytest.fixture
def task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Task:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    (tmp_path / "hit.py").write_text(FILE, encoding="utf-8")
    return task_of_file(str(tmp_path / "hit.py"))


@pytest.mark.parametrize(
    ("way", "share"),
    [
        ("scipy", 0.02),
        pytest.param("mujoco-sysid", 0.02, marks=pytest.mark.long),
        pytest.param("sbi", 0.1, marks=pytest.mark.long),  # the mean of a few draws from a posterior
        pytest.param("dropo", 0.05, marks=pytest.mark.long),  # of a few draws from a distribution
    ],
)
def test_the_fit_finds_the_parameters_and_the_search_earns_their_reward(task, way, share):
    script = fitting_scripts.FittingScript(task, fitting_scripts.INFERENCES[way])
    truth, actions, contexts = np.array([0.22]), np.array([[0.4], [0.9]]), np.array([[0.6], [1.4]])
    rollouts = script.simulated(truth, contexts, actions)
    trials = trials_of_rows(contexts, actions, rollouts.observation, np.zeros(2), rollouts.end_state)
    history = ((ParticleTrials(Particle(task.parameters.middle[None]), trials),),)
    (particle,) = script.next(history, np.random.default_rng(0))
    assert particle.mean == pytest.approx(truth, rel=share)
    policy, goal = script.final(history), np.array([1.1])
    end = 0.3 * policy(goal)[0] / truth[0] + 0.1 * goal[0]
    assert end == pytest.approx(goal[0], abs=0.03 + share)
    assert policy.predict(goal)[0] > 0.92 - share


def test_a_row_that_is_stored_is_not_made_again(tmp_path):
    kept = Kept(tmp_path / "rows.jsonl")
    assert not kept.knows("hit wd udr", 0)
    kept.row("hit wd udr", 0, lambda: {"first": 0.1, "final": 0.2, "rollouts": 9})
    again = Kept(tmp_path / "rows.jsonl")
    assert again.knows("hit wd udr", 0)
    rows = [again.row("hit wd udr", 0, lambda: pytest.fail("made again")), {"first": 0.3, "final": 0.6, "rollouts": 11}]
    assert own_simulator.line("udr", "wd", rows).split()[2:] == ["2", "0.200", "0.400", "0.200", "to", "0.600", "10"]
