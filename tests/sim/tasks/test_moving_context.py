"""A context that moves things is an input of dataset, emulator, grid, reality and world tables."""

from __future__ import annotations

import functools
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from moving_task import TASK, Unmodelled, best_speed, simulate

from hw.types import Array
from perception.types import ObjectTrack
from sim.adaptation.adaptation import Adaptation
from sim.adaptation.method import Trial, trials_of_rows
from sim.adaptation.methods.adaptsim import AdaptSim
from sim.adaptation.outcome_posterior import OutcomePosterior
from sim.adaptation.reward_table import RewardTableSettings, tabulate_rewards
from sim.adaptation.sessions import begin_in_memory
from sim.adaptation.simulators import Simulators
from sim.lab.world import Faults, Sensing, World
from sim.research.benchmark import tables
from sim.research.benchmark.tables import PlannedTable
from sim.research.benchmark.trial_sources import TableTrials
from sim.rollouts.dataset import Dataset, build_dataset, dataset_requests
from sim.rollouts.executors import serial_executor
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.training import EmulatorSettings, train_emulator
from sim.solvers.grid import grid_solver
from sim.solvers.misfit import misfit
from sim.solvers.solver import policy_for
from sim.tasks.fingerprint import fingerprint, scene_key
from sim.tasks.task import Mirror, SolvedPolicy, Solver, Task

CONTEXTS = np.array([[0.05], [0.2], [0.35], [0.55]])
SETTINGS = EmulatorSettings(hidden=64, layers=2, learning_rate=3e-3, least_steps=800, most_steps=800)


def still(observation: Array, context: Array) -> Array:
    return observation


@functools.cache
def dataset(task: Task = TASK) -> Dataset:
    with tempfile.TemporaryDirectory() as folder, serial_executor() as executor:
        return build_dataset(task, Path(folder), 1024, 0, executor)


@functools.cache
def emulator() -> Emulator:
    return train_emulator(TASK, dataset(), 0, SETTINGS)[0]


@functools.cache
def method(solver: Solver) -> AdaptSim:
    return AdaptSim(Simulators(solver, tabulate_rewards(solver, 0, RewardTableSettings(32, 256, 8))))


def off(policy: SolvedPolicy, mu: float) -> float:
    """How far the ball stops from 1 m, on average over contexts, in m."""
    ends = [simulate(np.array([mu]), c, policy(c), np.zeros(0)).state[-1, 0] for c in CONTEXTS]
    return float(np.abs(np.array(ends) - 1.0).mean())


def real_trials(mu: float, policy: SolvedPolicy, wind_m: float = 0.0, contexts: Array = CONTEXTS) -> tuple[Trial, ...]:
    actions = np.stack([policy(c) for c in contexts])
    tracks = [
        simulate(np.array([mu]), c, a, np.zeros(0), Unmodelled(wind_m)) for c, a in zip(contexts, actions, strict=True)
    ]
    scores = np.array([TASK.score(track, c) for track, c in zip(tracks, contexts, strict=True)])
    return trials_of_rows(
        contexts, actions, np.stack([TASK.observation(t) for t in tracks]), scores, map(TASK.end_of, tracks)
    )


def test_a_dataset_holds_contexts_only_where_they_move_things():
    moved, fixed = dataset().requests, dataset_requests(replace(TASK, relocate=still), 0, 64)
    assert np.ptp(moved.context) > 0.55
    assert not np.ptp(fixed.context)
    assert fingerprint(TASK) != fingerprint(replace(TASK, relocate=still))
    assert scene_key(TASK) != scene_key(replace(TASK, relocate=still))
    shuffled = replace(dataset(), requests=replace(moved, context=moved.context[::-1]))
    assert dataset().identity != shuffled.identity


def test_a_mirror_that_does_not_say_how_the_context_turns_is_refused():
    with pytest.raises(ValueError, match="rolling has a mirror, which does not say how its context is mirrored"):
        replace(TASK, mirror=Mirror(*(np.ones(1) for _ in range(5))))


def test_the_emulator_predicts_in_the_context_of_the_trial():
    mu = np.full((4, 1), 1.2)
    speed = np.array([[best_speed(1.2, c[0])] for c in CONTEXTS])
    true = np.array([TASK.observation(simulate(*row, np.zeros(0))) for row in zip(mu, CONTEXTS, speed, strict=True)])
    paths = emulator().trajectories(mu, speed, np.zeros((4, 0)), CONTEXTS)
    assert np.abs(paths - true).max() < 0.03
    assert np.abs(emulator().outcomes(mu, speed, np.zeros((4, 0)), CONTEXTS).end_state.mean(axis=0) - 1.0).max() < 0.06
    limit = emulator().misfit_limit
    own, other = (misfit(emulator(), c, speed[0], true[0]) for c in (CONTEXTS[0], CONTEXTS[3]))
    assert own < limit < other


@pytest.mark.parametrize("solver", [emulator, lambda: grid_solver(TASK)], ids=["emulator", "grid"])
def test_a_policy_acts_for_its_context(solver):
    policy = policy_for(solver(), np.array([[1.2]]))
    assert off(policy, 1.2) < 0.07
    assert off(policy, 0.8) > 0.2
    assert np.array_equal(policy.actions(CONTEXTS), np.stack([policy(c) for c in CONTEXTS]))


@pytest.mark.long
def test_a_session_finds_the_friction_from_trials_in_any_context():
    adaptation = Adaptation(method(emulator()), emulator(), emulator())

    def play(policy: SolvedPolicy, iteration: int, particle: int) -> tuple[Trial, ...]:
        return real_trials(1.5, policy, contexts=CONTEXTS[[iteration % 4, (iteration + 2) % 4]])

    rng = np.random.default_rng(0)
    *_, history = begin_in_memory(adaptation, play, (2, 2), rng, lambda _: rng).iterations(2)
    assert off(adaptation.final(history), 1.5) < 0.08
    best, forecast = method(emulator()).assess(history)
    assert forecast.reward > 0.8
    assert best.trials == 8


def test_a_discrepancy_varies_over_actions_and_contexts():
    simulators = method(emulator()).simulators
    """The ball rolls farther than on the slipperiest floor: no parameters explain that."""
    policy = policy_for(emulator(), np.array([[0.6]]))
    trials = real_trials(0.6, policy, wind_m=0.5, contexts=CONTEXTS[:1].repeat(4, 0))
    posterior, action = OutcomePosterior(simulators, trials), trials[0].action[None]

    def added_m(context: Array) -> float:
        """The mean discrepancy in where the ball stops."""
        drawn = simulators.disturbances
        executed = action[:, None, None] + drawn.error
        expected = emulator().outcomes(posterior.parameters[None, :, None], executed, drawn.nuisance, context).end_state
        return float((posterior.outcomes(action, context).predicted.end_state - expected.mean(axis=0)).mean())

    near, far = added_m(CONTEXTS[0]), added_m(CONTEXTS[3])
    assert near > 0.05
    assert abs(far) < 0.5 * near
    assert simulators.places(action, CONTEXTS[0]).shape == (1, simulators.place_size) == (1, 2)


def _in(world: World, parameters: Array, context: Array, action: Array, nuisance: Array) -> ObjectTrack:
    return simulate(world.parameters, context, action, nuisance, world.unmodelled)


def test_a_world_table_answers_with_the_nearest_action_and_context(monkeypatch, tmp_path):
    rolling_in = lambda world, task: replace(task, simulate=partial(_in, world), simulate_many=None)  # noqa: E731
    monkeypatch.setattr(tables, "task_in", rolling_in)  # the task is not registered
    world = World("here", "rolling", "", np.array([1.2]), np.zeros(0), Unmodelled(), Sensing(), Faults())
    with serial_executor() as executor:
        planned = PlannedTable(emulator(), "none", "scene", world, tmp_path, 256)
        table = planned.build(executor, lambda done, total: None)
    assert np.ptp(table.requests.context) > 0.55
    place, rng = TableTrials(TASK, table), np.random.default_rng(0)
    best = place.best_actions(CONTEXTS)
    wanted = [best_speed(1.2, c[0]) for c in CONTEXTS]
    assert np.abs(best[:, 0] - wanted).max() < 0.12
    assert place.score(CONTEXTS, best, rng).mean() > 0.8
    assert place.score(CONTEXTS[::-1], best, rng).mean() < 0.6
    starts = [TASK.observation.denormalise(t.observation)[0, 0] for t in place.play(CONTEXTS, best, rng)]
    assert np.abs(np.array(starts) - CONTEXTS[:, 0]).max() < 0.15
