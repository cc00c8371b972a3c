"""The double pendulum: dynamics, optimality, the numbers that the method states, and stacks against single rollouts."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_are, solve_continuous_lyapunov

from hw.dynamics import GRAVITY_M_S2
from perception.types import Outcome
from sim.errors import NoHardware
from sim.lab.world import list_worlds, load_world
from sim.solvers.misfit import misfit
from sim.tasks.pendulum import TASK
from sim.tasks.pendulum.params import START
from sim.tasks.pendulum.rollout import closed_loop, cost, excess, exponential, linearise, optimal, riccati
from sim.tasks.pendulum.solver import LqrSolver, rewards

NOTHING = np.zeros(0)
SOLVER = LqrSolver(TASK)


def draws(n, seed=0):
    return TASK.margin.sample(np.random.default_rng(seed), n)


def accelerations(parameters, q, rates, torques):
    """Lagrange's equations of the full, nonlinear pendulum, angles from upright, differentiated by hand."""
    m1, m2, b1, b2 = parameters
    q1, q2 = q
    c, s = np.cos(q2), np.sin(q2)
    M = np.array([[m1 + 2 * m2 + 2 * m2 * c, m2 + m2 * c], [m2 + m2 * c, m2]])
    coriolis = np.array([-m2 * s * (2 * rates[0] * rates[1] + rates[1] ** 2), m2 * s * rates[0] ** 2])
    outer = GRAVITY_M_S2 * m2 * np.sin(q1 + q2)
    gravity = np.array([GRAVITY_M_S2 * (m1 + m2) * np.sin(q1) + outer, outer])
    return np.linalg.solve(M, torques - coriolis + gravity - np.array([b1, b2]) * rates)


def test_the_linearisation_is_that_of_the_full_equations():
    step = 1e-6
    for parameters in draws(5):
        A, B = linearise(parameters)
        for k, unit in enumerate(np.eye(6)):
            x, u = step * unit[:4], step * unit[4:]
            slope = accelerations(parameters, x[:2], x[2:], u) / step
            expected = A[2:, k] if k < 4 else B[2:, k - 4]
            assert np.allclose(slope, expected, rtol=1e-5, atol=1e-5)


def test_riccati_cost_and_exponential_agree_with_scipy():
    parameters = draws(20)
    A, B = linearise(parameters)
    for a, b, P in zip(A, B, riccati(A, B), strict=True):
        assert np.allclose(P, solve_continuous_are(a, b, np.eye(4), np.eye(2)), rtol=1e-8)
    gains, _ = optimal(TASK.parameters.sample(np.random.default_rng(1), 20))
    closed = closed_loop(parameters, gains)
    for c, k, j in zip(closed, gains, cost(closed, gains), strict=True):
        if np.isfinite(j):
            assert j == pytest.approx(START @ solve_continuous_lyapunov(c.T, -np.eye(4) - k.T @ k) @ START, rel=1e-9)
        else:
            assert np.linalg.eigvals(c).real.max() >= -1e-8
    assert np.allclose(exponential(0.05 * closed), [expm(0.05 * c) for c in closed], atol=1e-11)


def test_every_perturbed_gain_costs_more():
    parameters, rng = draws(30), np.random.default_rng(2)
    gains, best = optimal(parameters)
    assert np.allclose(cost(closed_loop(parameters, gains), gains), best, rtol=1e-9)
    for scale in (1e-3, 1e-2, 1e-1):
        assert (excess(parameters, gains * (1.0 + scale * rng.standard_normal(gains.shape))) > 0.0).all()


@pytest.mark.parametrize(
    ("world", "best", "centre"),
    [("wd", 1.0, 0.87), ("ood-1", 0.40, 0.0), ("ood-2", 0.86, 0.35), ("ood-3", 0.98, 0.72), ("ood-4", 0.82, 0.0)],
)
def test_the_best_and_the_middle_of_omega_earn_what_the_method_states(world, best, centre):
    target = load_world(world, TASK).parameters
    corners = np.stack(np.meshgrid(*[np.linspace(1.0, 2.0, 6)] * 4, indexing="ij"), axis=-1).reshape(-1, 4)
    gains = optimal(corners)[0].reshape(-1, 8)
    assert rewards(target, gains).max() == pytest.approx(best, abs=0.02)
    middle = optimal(np.full(4, 1.5))[0].reshape(8)
    assert rewards(target, middle) == pytest.approx(centre, abs=0.01)


def test_the_worlds_are_those_of_table_a2_and_no_mass_is_clipped():
    assert set(list_worlds(TASK)) == {"wd", "ood-1", "ood-2", "ood-3", "ood-4"}
    assert load_world("ood-1", TASK).parameters.tolist() == [1.8, 0.3, 1.5, 1.5]
    light, lighter = (linearise(np.array([1.8, m2, 1.5, 1.5]))[0] for m2 in (0.5, 0.3))
    assert not np.allclose(light, lighter)


def test_a_stack_and_its_single_rollouts_are_the_same():
    targets, actions = draws(9), optimal(TASK.parameters.sample(np.random.default_rng(3), 9))[0].reshape(9, 8)
    many = TASK.simulate_many(targets, np.zeros((9, 0)), actions, np.zeros((9, 0)))
    for target, action, track in zip(targets, actions, many, strict=True):
        alone = TASK.simulate(target, NOTHING, action, NOTHING)
        assert np.allclose(alone.state, track.state, rtol=1e-12, atol=1e-12)
        assert alone.outcome is track.outcome


def test_a_track_starts_hanging_and_ends_upright_and_its_score_is_the_exact_reward():
    target = TASK.parameters.low
    action = optimal(np.full(4, 1.6))[0].reshape(8)
    track = TASK.simulate(target, NOTHING, action, NOTHING)
    assert track.state[0, :4].tolist() == START.tolist()
    assert np.abs(track.state[-1, :2]).max() < 0.2
    assert TASK.score(track, NOTHING) == pytest.approx(float(rewards(target, action)), abs=1e-12)
    assert TASK.observation(track).shape == (24,)
    long = np.linalg.norm(np.diff(track.state[:, :2], axis=0), axis=1).max()
    assert long < 1.0, "the grid is fine enough to draw"


def test_a_feedback_that_does_not_hold_it_earns_nothing_and_stays_finite():
    track = TASK.simulate(TASK.parameters.low, NOTHING, np.zeros(8), NOTHING)
    assert track.outcome is Outcome.DIVERGED
    assert TASK.score(track, NOTHING) == 0.0
    assert np.isfinite(track.state).all()
    assert rewards(TASK.parameters.low, np.zeros(8)) == 0.0
    seen = SOLVER.trajectories(TASK.parameters.low[None], np.zeros((1, 8)), np.zeros((1, 0)), np.zeros((1, 0)))[0]
    assert np.allclose(seen, TASK.observation(track), rtol=0.0, atol=1e-12)


def test_a_pendulum_that_settles_and_earns_nothing_says_why():
    target = load_world("ood-1", TASK).parameters
    dear = TASK.simulate(target, NOTHING, optimal(np.full(4, 1.5))[0].reshape(8), NOTHING)
    best = TASK.simulate(target, NOTHING, optimal(target)[0].reshape(8), NOTHING)
    assert (dear.outcome, best.outcome) == (Outcome.SETTLED, Outcome.SETTLED)
    assert TASK.score(dear, NOTHING) == 0.0
    assert dear.flags[0].startswith(f"it settles, but at {1 + dear.state[-1, -1]:.3g} times the least possible cost")
    assert best.flags == ()


def test_every_optimal_gain_of_the_margin_lies_in_the_action_space():
    assert all(TASK.action.contains(k.reshape(8)) for k in optimal(draws(500))[0])


def test_the_policy_of_many_samples_is_that_of_their_mean():
    samples = TASK.parameters.sample(np.random.default_rng(4), 8)
    (wide,) = SOLVER.policies(samples[None], np.random.default_rng(0))
    (narrow,) = SOLVER.policies(samples.mean(axis=0)[None, None], np.random.default_rng(0))
    assert np.allclose(wide(NOTHING), narrow(NOTHING))
    assert narrow.predict(NOTHING) == pytest.approx((1.0, 1.0, 1.0), abs=1e-6)
    mean, low, high = wide.predict(NOTHING)
    assert 0.0 <= low < mean < high <= 1.0


def test_what_the_ranges_cannot_express_is_noticed():
    gain = optimal(np.full(4, 1.5))[0].reshape(8)
    limit = 1.5 * SOLVER.misfit_limit

    def strange(target):
        track = TASK.simulate(target, NOTHING, gain, NOTHING)
        return misfit(SOLVER, NOTHING, gain, TASK.observation(track)) > limit

    assert sum(strange(t) for t in TASK.parameters.sample(np.random.default_rng(6), 10)) <= 1
    assert strange(load_world("ood-4", TASK).parameters)


def test_it_needs_no_scene():
    with pytest.raises(NoHardware, match="the task pendulum has no motion for a robot arm"):
        TASK.require_hardware()
    assert dataclasses.replace(TASK, name="other").exact(TASK).task is TASK
