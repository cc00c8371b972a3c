"""Baselines, ablations and fixed rules of a benchmark, on the pendulum and on a task with an emulator."""

import numpy as np
import pytest
from toy_learning import reward_table, trained
from toy_task import TOY

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.method import OwnPolicies, ParticleTrials, Trial
from sim.adaptation.methods.adaptsim import AdaptSim
from sim.adaptation.simulators import PartStrengths, Simulators
from sim.errors import CheckpointError, UnknownName
from sim.lab.world import load_world
from sim.research.benchmark import baselines
from sim.research.benchmark.entries import BASELINES, FIXED_RULES, Entry, make_entry, require_entry
from sim.research.benchmark.jobs import Job, run_job
from sim.research.benchmark.knowledge import RangedSolver, with_ranges
from sim.research.benchmark.sessions import Conditions
from sim.tasks import get_task

PENDULUM = get_task("pendulum")


def earned(entry, world="ood-2", budget=2):
    return run_job(
        Job("pendulum", "default", "named", world, "0" * 16, entry, 0, Conditions(budget), load_world(world, PENDULUM))
    ).reward


def observed(parameters, action):
    """A trial of the pendulum as its simulator predicts it."""
    solver = load_checkpoint(PENDULUM).solver
    path = solver.trajectories(parameters[None], action[None], np.zeros((1, 0)))[0]
    return Trial(np.zeros(0), action, path, 0.5, np.zeros(1))


def test_the_name_of_an_entry_says_which_ranges_it_is_told():
    assert Entry.parse("random") == Entry("random", None)
    assert Entry.parse("random@margin") == Entry("random", "margin")
    with pytest.raises(UnknownName, match="random@all: after @ there is omega or margin"):
        Entry.parse("random@all")


@pytest.mark.long
def test_least_squares_needs_one_trial_where_physics_is_exact_and_fails_with_ranges_that_do_not_hold_the_truth():
    assert earned("least-squares") == pytest.approx(1.0, abs=1e-3)
    assert earned("least-squares@omega") < 0.999
    with pytest.raises(CheckpointError, match="least-squares needs an exact simulator"):
        require_entry("least-squares", load_checkpoint(get_task("pushing")))


def test_simopt_moves_its_gaussian_towards_the_truth_and_no_farther_than_its_bound():
    checkpoint = load_checkpoint(PENDULUM)
    method = baselines.SimOpt(checkpoint.solver)
    truth = PENDULUM.parameters.denormalise(np.array([0.8, 0.2, 0.7, 0.3]))
    particle = method.start(1, np.random.default_rng(0))[0]
    action = method.policy(particle, ()).actions(np.zeros((1, 0)))[0]
    history = [(ParticleTrials(particle, (observed(truth, action),)),)] * 4
    unit = PENDULUM.parameters.normalise(truth)
    before, after = (float(np.linalg.norm(method.gaussian(h)[0] - unit)) for h in ((), history))
    assert after < 0.7 * before
    weights = baselines._bounded_weights(np.random.default_rng(0).random(4000))
    divergence = float((weights * np.log(np.maximum(weights * 4000, 1e-300))).sum())
    assert divergence == pytest.approx(baselines.BOUND, abs=0.05)


def test_best_of_first_keeps_the_rule_that_earned_most():
    method = BASELINES["best-of-first"](PENDULUM, load_checkpoint(PENDULUM))
    assert isinstance(method, OwnPolicies)
    first, second = method.start(2, np.random.default_rng(0))
    assert not np.array_equal(first.samples, second.samples)

    def tried(particle, reward):
        return ParticleTrials(particle, (Trial(np.zeros(0), np.zeros(8), np.zeros(24), reward, np.zeros(1)),))

    history = [(tried(first, 0.2), tried(second, 0.9))]
    third, fourth = method.next(history, np.random.default_rng(0))
    assert len({p.samples.tobytes() for p in (first, second, third, fourth)}) == 4
    kept = method.final([*history, (tried(third, 0.5), tried(fourth, 0.1))])
    assert kept.actions(np.zeros((1, 0))).tolist() == method.policy(second, ()).actions(np.zeros((1, 0))).tolist()


@pytest.mark.long
def test_fixed_rules_need_no_trial_and_the_best_mean_over_the_ranges_beats_the_gain_of_their_mean():
    checkpoint = load_checkpoint(PENDULUM)
    first, second = (FIXED_RULES[name](checkpoint, 0)[0] for name in ("first-action", "second-action"))
    method = make_entry("adaptsim", PENDULUM, checkpoint)
    assert isinstance(method, OwnPolicies)
    started = [method.policy(p, ()) for p in method.start(2, np.random.default_rng(0))]
    nowhere = np.zeros((1, 0))
    assert [p.actions(nowhere).tolist() for p in (first, second)] == [p.actions(nowhere).tolist() for p in started]
    truths = PENDULUM.parameters.sample(np.random.default_rng(5), 512)

    def mean(policies):
        actions = [np.tile(p.actions(nowhere)[0], (len(truths), 1, 1)) for p in policies]
        return np.mean(
            [checkpoint.solver.expected_rewards(truths, nowhere, a, np.random.default_rng(0)) for a in actions]
        )

    assert mean(FIXED_RULES["udr-mean"](checkpoint, 0)) > mean(FIXED_RULES["udr"](checkpoint, 0)) + 0.02


@pytest.mark.long
def test_ranges_change_what_a_method_is_told_and_nothing_that_the_simulator_says():
    solver = trained()[0]
    checkpoint = load_checkpoint(PENDULUM)
    inside = with_ranges(checkpoint, "omega")
    unit = PENDULUM.parameters.normalise(inside.reward_table.truths)
    assert ((unit >= 0.0) & (unit <= 1.0)).all()
    assert inside.solver.task.parameters == PENDULUM.parameters
    wide = with_ranges(checkpoint, "margin")
    assert np.ptp(PENDULUM.parameters.normalise(wide.reward_table.candidates), axis=0).min() > 1.5
    ranged = RangedSolver(TOY, solver)
    at = (TOY.margin.middle[None], TOY.action.middle[None], TOY.nuisance.middle[None])
    assert ranged.trajectories(*at).tolist() == solver.trajectories(*at).tolist()


@pytest.mark.long
def test_without_weights_no_simulator_is_preferred_and_without_discrepancy_none_is_doubted():
    whole, unweighed, undoubted = (
        AdaptSim(Simulators(trained()[0], reward_table(), strengths))
        for strengths in (PartStrengths(), PartStrengths(weights=0.0), PartStrengths(discrepancy=0.0))
    )
    context, action = TOY.reference_context, TOY.action.middle
    path = trained()[0].trajectories(TOY.margin.middle[None], action[None], TOY.nuisance.middle[None])[0]
    particle = whole.start(1, np.random.default_rng(0))[0]
    history = [(ParticleTrials(particle, (Trial(context, action, path, 0.0, None),)),)]
    assert np.ptp(unweighed.outcome_posterior(history).weights) == pytest.approx(0.0)
    assert np.ptp(whole.outcome_posterior(history).weights) > 0.0
    spread = [m.final(history).predict(context) for m in (whole, undoubted)]
    assert spread[1][2] - spread[1][1] < spread[0][2] - spread[0][1]
