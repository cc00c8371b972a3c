"""The parameters of an exact simulator after one trial, also beyond the margin."""

from dataclasses import replace

import numpy as np
import pytest

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.exact_fit import LEAST_LEFT, exact_fit, is_exact
from sim.adaptation.method import Trial
from sim.adaptation.methods import make_method
from sim.lab.drawn import drawn_world
from sim.research.benchmark.sessions import Conditions, run_session
from sim.research.benchmark.trial_sources import SimulatedTrials
from sim.tasks import get_task
from sim.tasks.pendulum.rollout import optimal
from sim.tasks.pendulum.solver import rewards

TASK = get_task("pendulum")
CHECKPOINT = load_checkpoint(TASK)
TRUTHS, PRIOR = CHECKPOINT.reward_table.truths[:1024], CHECKPOINT.reward_table.prior
INSIDE, OUTSIDE, BEYOND = (1.3, 1.7, 1.2, 1.9), (0.5, 2.4, 8.0, 3.0), (3.0, 1.2, 14.0, 4.0)


def trial(parameters) -> Trial:
    action = optimal(TASK.parameters.middle)[0].reshape(-1)
    path = CHECKPOINT.solver.trajectories(np.array([parameters]), action[None], np.zeros((1, 0)))[0]
    return Trial(np.zeros(0), action, path, 0.0, np.zeros(1))


@pytest.mark.parametrize("parameters", [INSIDE, OUTSIDE, BEYOND])
def test_one_trial_fixes_all_parameters(parameters):
    assert is_exact(CHECKPOINT.solver)
    fit = exact_fit(CHECKPOINT.solver, [trial(parameters)], TRUTHS, PRIOR)
    assert fit.left == LEAST_LEFT
    assert fit.weights.sum() == pytest.approx(1.0)
    assert fit.weights @ fit.parameters == pytest.approx(np.array(parameters), rel=0.02)


def test_what_no_parameters_explain_is_left_and_widens_the_posterior():
    clean = trial(INSIDE)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(clean.observation.shape)
    noisy = replace(clean, observation=clean.observation + noise)
    fits = [exact_fit(CHECKPOINT.solver, [one], TRUTHS, PRIOR) for one in (clean, noisy)]
    spread = [np.sqrt(fit.weights @ (fit.parameters - fit.weights @ fit.parameters) ** 2) for fit in fits]
    assert fits[1].left > 10.0 * fits[0].left
    assert (spread[1] > 5.0 * spread[0]).all()


@pytest.mark.long
@pytest.mark.parametrize("parameters", [INSIDE, OUTSIDE, BEYOND])
def test_a_session_earns_almost_everything_after_two_trials(parameters):
    world = replace(drawn_world(TASK, 41, 0), parameters=np.array(parameters))
    place = SimulatedTrials(CHECKPOINT.solver, world)
    policy = run_session(CHECKPOINT.solver, make_method("adaptsim", TASK, CHECKPOINT), place, Conditions(2), 0)[-1]
    action = policy.actions(np.zeros((1, 0)))[0]
    assert TASK.action.contains(action)
    assert rewards(world.parameters, action) > 0.995
