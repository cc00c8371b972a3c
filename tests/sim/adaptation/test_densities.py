"""The prior of a session: uniform, or the posterior of another session, also an exact one."""

from dataclasses import replace

import numpy as np
import pytest

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.densities import ANOTHER_STD, UNSURE, Prior
from sim.adaptation.method import OwnPolicies
from sim.adaptation.methods import make_method
from sim.adaptation.posterior import likelihood_of, posterior
from sim.adaptation.reward_table import begun_with
from sim.lab.drawn import drawn_world
from sim.research.benchmark.sessions import Conditions, run_iterations
from sim.research.benchmark.trial_sources import SimulatedTrials
from sim.rollouts.draws import sobol
from sim.tasks import get_task
from sim.tasks.pendulum.rollout import optimal
from sim.tasks.pendulum.solver import rewards

TASK = get_task("pendulum")
CHECKPOINT = load_checkpoint(TASK)
HERE, THERE, BEYOND = (1.3, 1.7, 1.2, 1.9), (0.5, 2.4, 8.0, 3.0), (3.0, 1.2, 14.0, 4.0)


def box(n: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(n), np.ones(n)


def session(checkpoint, parameters, budget: int = 2):
    """Its history and its final reward in the pendulum with these parameters."""
    place = SimulatedTrials(checkpoint.solver, replace(drawn_world(TASK, 41, 0), parameters=np.array(parameters)))
    method = make_method("adaptsim", TASK, checkpoint)
    assert isinstance(method, OwnPolicies)
    *_, history = run_iterations(checkpoint.solver, method, place, Conditions(budget), 0)
    action = method.final(history).actions(np.zeros((1, 0)))[0]
    return history, float(rewards(np.array(parameters), action))


def after(checkpoint, history):
    """The checkpoint of a session that begins with the posterior after `history`."""
    known = posterior(likelihood_of(checkpoint), history)
    return replace(checkpoint, reward_table=begun_with(CHECKPOINT.reward_table, TASK, known.samples, known.weights))


@pytest.fixture(scope="module")
def begun():
    history, _ = session(CHECKPOINT, HERE)
    return after(CHECKPOINT, history)


@pytest.mark.parametrize("centre", [(0.5, 0.4), (0.0, 0.98)])
def test_a_prior_after_a_session_integrates_to_one_and_its_cloud_follows_it(centre):
    points = np.array(centre) + 1e-4 * np.random.default_rng(0).standard_normal((200, 2))
    prior = Prior.after(np.clip(points, 0.0, 1.0), np.full(200, 0.005), box(2))
    even = sobol(1 << 16, 2, np.random.default_rng(1))
    assert np.exp(prior.log_density(even)).mean() == pytest.approx(1.0, rel=0.02)
    cloud = prior.cloud(4096)
    assert np.isfinite(prior.log_density(cloud)).all()
    far = np.linalg.norm(cloud - centre, axis=1) > 5.0 * ANOTHER_STD
    assert far.mean() == pytest.approx(UNSURE, rel=0.05)
    assert far[:1024].mean() == pytest.approx(UNSURE, rel=0.3), "the first ones stand for all"
    assert np.isneginf(prior.log_density(np.array([[0.5, 1.01]])))


def test_an_exact_posterior_gives_a_prior_with_the_width_of_another_object(begun):
    known = posterior(likelihood_of(begun), ())
    assert known.effective > 1000
    low, high = TASK.margin.normalise(known.quantiles((0.05, 0.95)))
    truth = TASK.margin.normalise(np.array(HERE))
    assert ((low < truth) & (truth < high)).all()
    assert (high - low > 2.0 * ANOTHER_STD).all()
    quarter, three = TASK.margin.normalise(known.quantiles((0.25, 0.75)))
    assert (three - quarter < 2.0 * ANOTHER_STD).all(), "as wide as a normal density with a tenth of others"
    assert np.abs(TASK.margin.normalise(known.quantiles((0.5,))[0]) - truth).max() < ANOTHER_STD


def test_a_truth_of_the_new_prior_has_the_rewards_of_the_nearest_one_of_the_checkpoint():
    own = CHECKPOINT.reward_table
    samples = own.truths[:40]
    table = begun_with(own, TASK, samples, np.full(40, 0.025))
    assert table.truths.shape == own.truths.shape
    unit, theirs = (TASK.margin.normalise(one) for one in (table.truths[:50], own.truths))
    nearest = np.linalg.norm(unit[:, None] - theirs[None], axis=-1).argmin(axis=1)
    assert table.rewards[:, :50].tolist() == own.rewards[:, nearest].tolist()
    assert begun_with(own, TASK, samples, np.full(40, 0.025)).truths.tolist() == table.truths.tolist()


@pytest.mark.long
def test_the_first_action_of_the_next_session_is_nearly_the_best(begun):
    method = make_method("adaptsim", TASK, begun)
    assert isinstance(method, OwnPolicies)
    first = method.policy(method.start(2, np.random.default_rng(0))[0], ()).actions(np.zeros((1, 0)))[0]
    assert rewards(np.array(HERE), first) > 0.99
    plain = make_method("adaptsim", TASK, CHECKPOINT)
    assert isinstance(plain, OwnPolicies)
    unknown = plain.policy(plain.start(2, np.random.default_rng(0))[0], ()).actions(np.zeros((1, 0)))[0]
    assert rewards(np.array(HERE), first) > rewards(np.array(HERE), unknown)


@pytest.mark.long
@pytest.mark.parametrize("parameters", [HERE, THERE, BEYOND])
def test_a_wrong_prior_is_corrected_by_the_first_trials(begun, parameters):
    history, reward = session(begun, parameters)
    assert reward > 0.995
    known = posterior(likelihood_of(begun), history)
    low, high = known.quantiles((0.05, 0.95))
    assert ((low <= parameters) & (parameters <= high)).all()
    assert known.effective > 24


@pytest.mark.long
def test_a_posterior_beyond_the_margin_is_a_prior_too(begun):
    assert TASK.action.contains(optimal(np.array(BEYOND))[0].reshape(-1))
    history, _ = session(CHECKPOINT, BEYOND)
    third = after(CHECKPOINT, history)
    assert not TASK.margin.contains(third.reward_table.truths.mean(axis=0))
    method = make_method("adaptsim", TASK, third)
    assert isinstance(method, OwnPolicies)
    first = method.policy(method.start(2, np.random.default_rng(0))[0], ()).actions(np.zeros((1, 0)))[0]
    assert rewards(np.array(BEYOND), first) > 0.95
    assert session(third, HERE)[1] > 0.995
