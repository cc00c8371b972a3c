"""A task whose failures earn: it alone says how much, and everything that learns or predicts counts on it."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from toy_task import TOY, simulate

from perception.types import Outcome
from sim.adaptation.outcome_posterior import OutcomePosterior, PosteriorPolicy
from sim.adaptation.reward_table import RewardTableSettings, tabulate_rewards
from sim.adaptation.simulators import Simulators
from sim.rollouts.dataset import Dataset, draw_requests
from sim.rollouts.executors import serial_executor
from sim.rollouts.kept import KeptRollouts
from sim.rollouts.reward_soundness import reward_complaints
from sim.rollouts.run import Requests, Rollouts, concatenate, run_many
from sim.rollouts.sampled_rollouts import SampledRollout
from sim.rollouts.shards import read_rollouts, write_rollouts
from sim.solvers.direct import DirectSolver
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.training import EmulatorSettings, train_emulator
from sim.solvers.grid import grid_of
from sim.tasks.fingerprint import fingerprint, scene_key


def credit(track) -> float:
    """Up to 0.3 for a piece that was only pushed: the more, the nearer it stayed to its line."""
    return float(0.3 * np.exp(-((track.state[-1, 1] / 0.02) ** 2)))


CREDITED = dataclasses.replace(TOY, reward_of_failure=credit)
RNG = np.random.default_rng


@functools.cache
def rolled(count: int = 64) -> tuple[Requests, Rollouts]:
    requests = draw_requests(CREDITED, count, RNG(0))
    with serial_executor() as executor:
        return requests, run_many(CREDITED, requests, executor)


@functools.cache
def emulator() -> Emulator:
    settings = EmulatorSettings(members=3, hidden=48, layers=2, learning_rate=5e-3, least_steps=250, most_steps=250)
    return train_emulator(CREDITED, Dataset(*rolled(600), 600), 0, settings)[0]


def true_failure(row: int) -> float:
    requests = rolled()[0]
    track = simulate(requests.parameters[row], requests.context[row], requests.action[row], requests.nuisance[row])
    assert track.outcome is Outcome.ON_TABLE
    return credit(track)


def test_the_task_alone_decides_what_a_failure_earns():
    track = simulate(TOY.parameters.middle, TOY.reference_context, TOY.action.low, np.zeros(1))
    assert not TOY.succeeded(track)
    assert TOY.score(track, TOY.reference_context) == 0.0
    assert CREDITED.score(track, TOY.reference_context) == credit(track) > 0.0
    assert CREDITED.end_of(track) is None
    unsolved = dataclasses.replace(track, outcome=Outcome.SOLVER_FAILED)
    assert CREDITED.score(unsolved, TOY.reference_context) == 0.0


def test_rollouts_keep_the_reward_of_a_failure_and_are_read_again(tmp_path):
    requests, rollouts = rolled()
    row = int(np.flatnonzero(~rollouts.succeeded)[0])
    rewards = rollouts.rewards(CREDITED, requests.context)
    assert rewards[row] == true_failure(row)
    write_rollouts(tmp_path / "shard.npz", requests, rollouts)
    again = read_rollouts(tmp_path / "shard.npz", requests)
    assert again is not None
    assert np.array_equal(again.rewards(CREDITED, requests.context), rewards)
    half = concatenate([rollouts[:30], rollouts[30:]])
    assert np.array_equal(half.rewards(CREDITED, requests.context), rewards)
    assert "failure_reward" not in dataclasses.replace(rollouts, failure_reward=None).columns


def test_data_and_checkpoints_of_the_task_without_partial_credit_are_others():
    assert fingerprint(CREDITED) != fingerprint(TOY)
    more = dataclasses.replace(TOY, reward_of_failure=lambda track: 0.5 * credit(track))
    assert len({scene_key(task) for task in (TOY, CREDITED, more)}) == 3


@pytest.mark.long
def test_an_emulator_learns_what_a_failure_earns():
    fresh = draw_requests(CREDITED, 200, RNG(7))
    with serial_executor() as executor:
        true = run_many(CREDITED, fresh, executor)
    said = emulator().predict(fresh.parameters, fresh.context, fresh.action, fresh.nuisance).failure_reward
    assert said is not None
    assert true.failure_reward is not None
    failed = ~true.succeeded
    apart = np.abs(said - true.failure_reward)[failed].mean()
    assert apart < 0.5 * np.abs(true.failure_reward[failed] - true.failure_reward[failed].mean()).mean()
    restored = Emulator(CREDITED, emulator().tensors)
    assert np.array_equal(
        restored.predict(fresh.parameters, fresh.context, fresh.action, fresh.nuisance).failure_reward, said
    )
    expected = emulator().trial_rewards(fresh.parameters, fresh.context, fresh.action, fresh.nuisance)
    rewards = true.rewards(CREDITED, fresh.context)
    assert np.abs(expected - rewards).mean() < np.abs(np.where(true.succeeded, expected, 0.0) - rewards).mean()


def test_solvers_by_true_rollouts_expect_the_same_reward():
    rollouts = rolled()[1]
    failed = np.flatnonzero(~rollouts.succeeded)[:3]
    requests = rolled()[0][failed]
    with serial_executor() as executor:
        direct = DirectSolver(CREDITED, KeptRollouts(CREDITED, executor))
        expected = direct.trial_rewards(requests.parameters, requests.context, requests.action, requests.nuisance)
    assert expected.tolist() == [true_failure(row) for row in failed]
    grid = grid_of(CREDITED, 16, TOY.action.sample(RNG(0), 4))
    actions, nuisance = TOY.action.low[None], grid.draws[0]
    predicted = grid.outcomes(grid.points, actions, nuisance, TOY.reference_context)
    true = [simulate(p, TOY.reference_context, TOY.action.low, nuisance) for p in grid.points]
    earned = CREDITED.expected_reward(predicted, TOY.reference_context)[0]
    assert earned == pytest.approx([CREDITED.score(track, TOY.reference_context) for track in true])
    grid.remember(TOY.action.low, nuisance, rollouts_at(grid.points, nuisance))
    again = grid_of(CREDITED, 16, TOY.action.sample(RNG(0), 4))
    again.restore(grid.tensors)
    stored = again.outcomes(grid.points, actions, nuisance, TOY.reference_context)
    assert np.array_equal(CREDITED.expected_reward(stored, TOY.reference_context)[0], earned)


def rollouts_at(points: np.ndarray, nuisance: np.ndarray) -> Rollouts:
    requests, _ = Requests.broadcast(points, TOY.reference_context, TOY.action.low, nuisance)
    with serial_executor() as executor:
        return run_many(CREDITED, requests, executor)


@pytest.mark.long
def test_the_policy_of_a_session_counts_on_it():
    table = tabulate_rewards(emulator(), 3, RewardTableSettings(16, 64, 2))
    policy = PosteriorPolicy(OutcomePosterior(Simulators(emulator(), table), ()))
    context, action = TOY.reference_context, TOY.action.low[None]
    predicted = policy.outcomes(action, context)
    alone = dataclasses.replace(predicted.predicted, failure_reward=None)
    assert predicted.rewards(context).mean() > CREDITED.expected_reward(alone, context).mean() + 0.01


def test_a_reward_of_a_failure_beyond_one_is_named():
    generous = dataclasses.replace(TOY, reward_of_failure=lambda track: 1.5)
    inputs = TOY.parameters.middle, TOY.reference_context, TOY.action.low, np.zeros(1)
    told = list(reward_complaints(generous, [SampledRollout(*inputs, simulate(*inputs), 0.0)]))
    assert len(told) == 1
    assert "gives a failure the reward 1.5" in told[0]
