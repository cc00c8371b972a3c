"""Trained policies: stored without pickle, a library over Omega, a solver that chooses among its members."""

from __future__ import annotations

import copy
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from moving_task import TASK as ROLLING
from moving_task import Unmodelled

from hw.types import Array, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.methods.adaptsim import create
from sim.adaptation.outcome_posterior import OutcomePosterior
from sim.errors import CheckpointError, TaskError
from sim.lab.rollout import rollout_in
from sim.lab.world import Faults, Sensing, World
from sim.research.benchmark.jobs import simulations
from sim.research.pretraining import pipeline
from sim.research.pretraining.budget import OptionalStages, PretrainBudget
from sim.research.pretraining.grid_stage import grid_tensors, simulate_grid_share, trained
from sim.research.pretraining.pipeline import pretrain
from sim.rollouts.shares import Share
from sim.solvers.library import train_library, with_library
from sim.solvers.solver import policy_for
from sim.tasks.library import library_of, main_file
from sim.tasks.members import load_policy, train_member
from sim.tasks.task import Task
from sim.tasks.training import TrainedPolicies
from sim.types import Space

ROLLED: list[Array] = []


def roll(parameters: Array, context: Array, policy: Any, nuisance: Array, unmodelled: Any = None) -> ObjectTrack:
    """A ball that stops at 1 m if the policy's gain is the friction."""
    ROLLED.append(parameters)
    end_m = float(policy) / parameters[0] + (unmodelled or Unmodelled()).wind_m
    x_m = end_m * ROLLING.observation.times_s**0.5
    return ObjectTrack(ROLLING.observation.times_s, x_m[:, None], Outcome.SETTLED, np.full(3, np.nan), np.ones(3))


def train(samples: Any, seed: int) -> Any:
    return np.float64(np.mean([p.mu for p in samples]))


TASK: Task = replace(
    ROLLING,
    name="gains",
    context=Space(()),
    reference_context=frozen_array([]),
    simulate=roll,  # type: ignore[arg-type]
    action=ROLLING.parameters,
    action_noise=frozen_array([0.0]),
    reward_of_success=lambda end, context: np.maximum(0.0, 1.0 - np.abs(end[..., 0] - 1.0) / 0.5),
    training=TrainedPolicies(train, policies=5),
)


def trained_by(train: Any, load: Any = None) -> Task:
    return replace(TASK, training=TrainedPolicies(train, load, policies=5))


def member(task: Task, folder: Path) -> Any:
    return train_member(task, "one", np.array([[1.0], [1.2]]), np.array([1.1]), 0, folder / "one")


class Net(torch.nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.layer = torch.nn.Linear(2, 1)


def train_net(samples: Any, seed: int) -> torch.nn.Module:
    torch.manual_seed(seed)
    return Net()


def load_net(state: dict[str, torch.Tensor]) -> Net:
    net = Net()
    net.load_state_dict(state)
    return net


def write_file(samples: Any, seed: int, folder: Path) -> None:
    (folder / "weights.txt").write_text(str(samples[0].mu))


@pytest.mark.parametrize(
    ("returned", "expected"),
    [
        (np.arange(3.0), np.arange(3.0)),
        ({"w": np.ones((2, 2)), "b": np.zeros(2)}, {"w": np.ones((2, 2)), "b": np.zeros(2)}),
        ((np.ones(2), np.zeros((1, 3))), (np.ones(2), np.zeros((1, 3)))),
        ([1.0, 2.0], np.array([1.0, 2.0])),
    ],
    ids=["array", "by name", "sequence", "list of numbers"],
)
def test_arrays_come_back_as_they_were_returned(returned, expected, tmp_path):
    task = trained_by(lambda samples, seed: returned)
    loaded = load_policy(task, member(task, tmp_path))
    assert type(loaded) is type(expected)
    np.testing.assert_equal(loaded, expected)
    assert b"pickle" not in (tmp_path / "one" / "policy.npz").read_bytes()


def test_a_torch_module_is_stored_as_its_state_and_files_as_their_folder(tmp_path):
    task = trained_by(train_net, load_net)
    stored = member(task, tmp_path)
    assert main_file(stored).name == "policy.safetensors"
    loaded: Any = load_policy(task, stored)
    trained = train_net([], 0)
    assert all(torch.equal(loaded.state_dict()[name], value) for name, value in trained.state_dict().items())
    files = trained_by(write_file, lambda folder: float((folder / "weights.txt").read_text()))
    written = member(files, tmp_path / "files")
    assert load_policy(files, written) == 1.0
    assert main_file(written).name == "weights.txt"


@pytest.mark.parametrize(
    ("train", "words"),
    [
        (lambda samples, seed: samples[0].friction, "`train` of the task gains fails with seed 0 .*friction"),
        (lambda samples, seed: None, "returns nothing and wrote no file"),
        (lambda samples, seed: np.array([np.nan]), "not finite .*diverged"),
        (lambda samples, seed: np.array([object()]), "type object: return arrays of numbers"),
    ],
)
def test_a_training_that_fails_says_how_and_leaves_nothing(train, words, tmp_path):
    with pytest.raises(TaskError, match=words):
        member(trained_by(train), tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_changed_policy_is_refused(tmp_path):
    stored = member(TASK, tmp_path)
    np.savez(stored.folder / "policy.npz", policy=np.array(9.0))
    with pytest.raises(CheckpointError, match="was changed after its training"):
        member(TASK, tmp_path)


def test_a_library_fills_omega_and_is_trained_once(tmp_path):
    calls: list[int] = []

    def counting(samples: Any, seed: int) -> Any:
        calls.append(len(samples))
        return train(samples, seed)

    task, shown = trained_by(counting), list[tuple[int, int]]()
    with ThreadPoolExecutor(2) as crew:
        library = train_library(task, tmp_path, 0, crew, lambda *at: shown.append(at))
        again = train_library(task, tmp_path, 0, crew, lambda *at: None)
    assert sorted(calls) == [16, 16, 16, 16, 64]
    assert shown[0] == (0, 5)
    assert shown[-1] == (5, 5)
    assert np.array_equal(library.places, again.places)
    assert library.members[0].trained_for.tolist() == [pytest.approx(1.2)]
    assert np.ptp(library.places) > 0.4
    assert library.distance(task, library.places[3]) == 0.0
    assert library.nearest(task, library.places[3] + 1e-3).name == "policy-003"
    assert copy.deepcopy(library).members[2].name == "policy-002"


def test_phase_1_trains_simulates_and_stores_all_so_that_a_session_simulates_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "require_sound", lambda task, rng: None)  # its rollouts are as many as time allows
    with ThreadPoolExecutor(2) as crew:
        none = OptionalStages(policies=False, evaluation=False)
        budget = PretrainBudget.small(TASK)
        ROLLED.clear()
        path = pretrain(TASK, tmp_path, budget, 0, crew, lambda *at: None, stages=none)
        first = len(ROLLED)
        ROLLED.clear()
        assert pretrain(TASK, tmp_path, budget, 0, crew, lambda *at: None, stages=none) == path
        assert first - len(ROLLED) == 5 * 256, "the second run simulates no grid again"
    ROLLED.clear()
    checkpoint = load_checkpoint(TASK, str(path))
    assert checkpoint.card.simulations == 5 * 256
    assert simulations("random", checkpoint) == 5 * 256, "a benchmark says what its policies have cost"
    method, solver = create(checkpoint.solver.task, checkpoint), checkpoint.solver
    library = library_of(solver.task)
    assert library is not None
    assert len(library.members) == len(checkpoint.card.policies) == 5
    for mu in (0.85, 1.5):
        chosen = policy_for(solver, np.array([[mu]]))(np.zeros(0))
        assert abs(library.policy(TASK, library.nearest(TASK, chosen)) - mu) < 0.15
    assert OutcomePosterior(method.simulators, ()).candidate_outcomes(np.zeros(0)).actions.shape == (5, 1)
    method.start(2, np.random.default_rng(0))
    assert not ROLLED
    world = World("here", "gains", "", np.array([1.2]), np.zeros(0), Unmodelled(0.1), Sensing(), Faults())
    track = rollout_in(world, np.zeros(0), library.places[0], solver.task)
    gain = library.policy(TASK, library.members[0])
    assert track.state[-1, 0] == pytest.approx(gain / 1.2 + 0.1)
    (path / "policies" / "policy-001" / "policy.npz").write_bytes(b"something else")
    with pytest.raises(CheckpointError, match="was changed after its training"):
        load_checkpoint(TASK, str(path))


def test_a_task_with_library_replaces_its_own_library(tmp_path):
    with ThreadPoolExecutor(1) as crew:
        library = train_library(TASK, tmp_path, 0, crew, lambda *at: None)
    once, twice = with_library(TASK, library), with_library(with_library(TASK, library), library)
    assert once.simulate.task is twice.simulate.task is TASK  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "wrong", [{"policies": 1}, {"time_limit_s": 0.0}, {"distance": -0.1}, {"load": 3}], ids=lambda one: next(iter(one))
)
def test_contradictions_are_refused(wrong):
    with pytest.raises(ValueError, match=r"policies|limit|functions"):
        TrainedPolicies(train, **wrong)


@pytest.mark.long
def test_shares_train_the_library_and_then_simulate_its_grid(tmp_path):
    def share(number: int) -> bool | None:
        with ThreadPoolExecutor(2) as crew:
            return simulate_grid_share(TASK, tmp_path, 0, Share(number, 2), crew, lambda *at: None)

    assert share(1) is False, "the second share has trained nothing yet"
    assert sorted(path.name for path in (tmp_path / "policies").iterdir()) == ["everywhere", "policy-002", "policy-004"]
    assert share(2) is True
    assert share(1) is True
    files = sorted((tmp_path / "grid").iterdir())
    before = len(ROLLED)
    with ThreadPoolExecutor(2) as crew:
        task = trained(TASK, tmp_path, 0, crew, lambda *at: None)
        tensors = grid_tensors(tmp_path, task.exact(task), crew, lambda *at: None)
        costed = len(ROLLED)
        assert grid_tensors(tmp_path, task.exact(task), crew, lambda *at: None).keys() == tensors.keys()
    assert costed - before == len(ROLLED) - costed < 10, "only the cost is measured: every rollout was shared"
    assert sorted((tmp_path / "grid").iterdir()) == files
    assert np.array_equal(tensors["grid.success"], np.ones((5, 256)))
