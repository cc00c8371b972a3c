"""Fit and search with true rollouts: on a disc that a push slides across a table, with a goal as its context."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from moving_task import TASK as ROLLING

import adaptsim
from hw.types import Array
from perception.types import Outcome
from sim.adaptation.adaptation import Adaptation
from sim.adaptation.checkpoint import without_phase_1
from sim.adaptation.descent import descend_with_few
from sim.adaptation.method import Iteration, ParticleTrials, Trial
from sim.adaptation.methods import make_method
from sim.adaptation.methods.direct import DRAWS, Direct
from sim.adaptation.verdict import Kind
from sim.rollouts.executors import serial_executor
from sim.rollouts.kept import PART, KeptRollouts
from sim.rollouts.run import Requests
from sim.solvers.direct import DirectSolver, rollouts_of
from sim.tasks.task import Task

T_S = np.linspace(0.1, 1.0, 10)
TRUTH = np.array([0.12, 0.42])


@adaptsim.task(
    parameters={"mu": (0.1, 0.3), "mass": (0.2, 0.5, "kg")},
    context={"goal": (0.2, 0.6, "m")},
    action={"force": (2.0, 8.0, "N")},
    state={"x": (0.0, 2.0, "m")},
    duration=1.0,
    reward=lambda end, context: 1 - abs(end.x - context.goal) / 0.2,
)
def disc(p, action):
    """Push a disc to a goal."""
    braking = 9.81 * p.mu
    speed = 0.2 * max(action.force / p.mass - braking, 0.0)
    sliding = np.minimum(T_S, speed / braking)
    return T_S, (speed * sliding - 0.5 * braking * sliding**2)[:, None]


DISC: Task = disc


def solver_of(task: Task, folder: Path | None = None) -> DirectSolver:
    return DirectSolver(task, KeptRollouts(task, serial_executor(), folder))


def tried(method: Direct, truth: Array, history: tuple[Iteration, ...], rng: np.random.Generator) -> Iteration:
    """An iteration of two particles with two trials each, in the truth."""
    task = method.solver.task
    particles = method.next(history, rng) if history else method.start(2, rng)

    def trial(policy, context: Array) -> Trial:
        action = policy(context)
        track = task.simulate(truth, context, action, np.zeros(len(task.nuisance)))
        return Trial(context, action, task.observation(track), task.score(track, context), task.end_of(track))

    return tuple(
        ParticleTrials(one, tuple(trial(policy, context) for context in task.context.sample(rng, 2)))
        for one in particles
        for policy in [method.policy(one, history)]
    )


@pytest.mark.long
def test_a_session_finds_truth_and_reward_with_the_rollouts_that_it_announces():
    method, rng = Direct(solver_of(DISC)), np.random.default_rng(0)
    history: tuple[Iteration, ...] = ()
    for _ in range(3):
        history = (*history, tried(method, TRUTH, history, rng))
    earned = [np.mean([t.reward for entry in iteration for t in entry.trials]) for iteration in history]
    assert earned[0] < 0.6
    assert min(earned[1:]) > 0.95
    announced = method.rollouts_before(2) + method.rollouts_after(2, 1) + method.rollouts_after(2, 2)
    assert 0.5 * announced < method.solver.roll.simulated <= announced < 700
    found = DISC.margin.denormalise(method.fit(history).best)
    assert np.allclose(found, TRUTH, rtol=0.02)
    before, *_, after = method.draws_after_each(history)
    assert before.shape == after.shape == (DRAWS, 2)
    assert (after.std(axis=0) < 0.1 * before.std(axis=0)).all()


@pytest.mark.long
def test_draws_cover_the_truth_as_often_as_they_say_in_noisy_trials():
    task = replace(DISC, observation=replace(DISC.observation, noise_std=np.array([0.02])))
    inside, rng = list[bool](), np.random.default_rng(1)
    for truth in task.parameters.sample(rng, 24):
        method = Direct(solver_of(task))
        first = tried(method, truth, (), rng)
        noisy = tuple(
            replace(
                e,
                trials=tuple(replace(t, observation=task.observation.with_noise(t.observation, rng)) for t in e.trials),
            )
            for e in first
        )
        low, high = np.quantile(method.draws_after_each((noisy,))[-1], (0.05, 0.95), axis=0)
        inside += list((low <= truth) & (truth <= high))
    assert 0.75 <= np.mean(inside) <= 1.0  # 0.9 of 48, give or take two standard errors


@pytest.mark.long
def test_a_simulator_that_cannot_repeat_the_trials_gives_a_wide_posterior():
    def spread(bend: float) -> float:
        method, rng = Direct(solver_of(DISC)), np.random.default_rng(0)
        first = tried(method, TRUTH, (), rng)
        off = bend * np.sin(20.0 * np.arange(DISC.observation.size))
        bent = tuple(
            replace(e, trials=tuple(replace(t, observation=t.observation + off) for t in e.trials)) for e in first
        )
        return float(method.draws_after_each((bent,))[-1].std(axis=0)[0])

    assert spread(0.1) > 20.0 * spread(0.0)


@pytest.mark.long
def test_the_verdict_is_that_of_the_rewards_and_needs_no_rollouts():
    solver, rng = solver_of(DISC), np.random.default_rng(0)
    method = make_method("direct", DISC, without_phase_1(DISC, solver))
    assert isinstance(method, Direct)
    adaptation = Adaptation(method, solver, solver, likelihood=method)
    history: tuple[Iteration, ...] = ()
    for _ in range(2):
        history = (*history, tried(method, TRUTH, history, rng))
    posterior = adaptation.posterior(history)
    assert posterior is not None
    assert not posterior.is_collapsed
    before = solver.roll.simulated
    judged = adaptation.assess(history)
    assert judged.verdict.kind in (Kind.CONVERGED, Kind.NOT_CONVERGED)
    assert judged.verdict.strange == 0
    assert solver.roll.simulated == before


def test_a_context_that_moves_things_is_an_input_of_the_search():
    solver = solver_of(ROLLING)
    (policy,) = solver.policies(np.array([[[1.0]]]), np.random.default_rng(0))
    for start in (0.1, 0.5):  # on the carpet, and behind it
        context = np.array([start])
        track = ROLLING.simulate(np.array([1.0]), context, policy(context), np.zeros(0))
        assert ROLLING.score(track, context) > 0.8
    assert solver.roll.simulated <= rollouts_of(ROLLING, 1)


def test_a_failed_rollout_is_no_end_to_interpolate():
    def simulate(p, c, a, n, u=None):
        track = DISC.simulate(p, c, a, n, u)
        return replace(track, outcome=Outcome.SOLVER_FAILED) if a[0] > 4.0 else track

    task = replace(DISC, simulate=simulate)
    (policy,) = solver_of(task).policies(TRUTH[None, None], np.random.default_rng(0))
    assert (policy.actions(np.array([[0.2], [0.6]])) <= 4.1).all()


def test_rollouts_are_kept_one_by_one_for_the_next_process(tmp_path):
    first = KeptRollouts(DISC, serial_executor(), tmp_path)
    rows = np.linspace(2.0, 8.0, PART + 4)[:, None]
    n = len(rows)
    requests = Requests(np.tile(TRUTH, (n, 1)), np.full((n, 1), 0.4), rows, np.zeros((n, 0)))
    whole = first(requests)
    assert first.simulated == n
    assert len(list(tmp_path.glob("*.npz"))) == 2
    again = KeptRollouts(DISC, serial_executor(), tmp_path)
    assert np.array_equal(again(requests[::-1]).observation, whole.observation[::-1])
    assert again.knows(requests).all()
    assert again.simulated == 0
    next(iter(tmp_path.glob("*.npz"))).write_bytes(b"damaged")
    damaged = KeptRollouts(DISC, serial_executor(), tmp_path)
    assert np.array_equal(damaged(requests).observation, whole.observation)
    assert 0 < damaged.simulated < n


def test_a_descent_with_few_evaluations_reaches_the_least_squares():
    calls = list[int]()

    def residuals(points: Array) -> Array:
        calls.append(len(points))
        return np.stack([points[:, 0] ** 2 - 0.25, points[:, 0] * points[:, 1] - 0.35], axis=1)

    point, left = descend_with_few(residuals, np.array([0.8, 0.4]), (np.zeros(2), np.ones(2)), 0.02)
    assert sum(calls) == 1 + 2 + 2 * 3
    assert left < 1e-4
    assert np.allclose(point, [0.5, 0.7], atol=0.02)
    edge, _ = descend_with_few(residuals, np.array([0.8, 0.4]), (np.array([0.6, 0.0]), np.ones(2)), 0.02)
    assert edge[0] == pytest.approx(0.6)
