"""The default method: simulators are weighed by trials, and what reality adds to them is learnt as well."""

import dataclasses
import functools

import numpy as np
import pytest
from scipy.stats import multivariate_t
from toy_learning import TARGET, reward_table, trained, tried
from toy_learning import trial as one_trial
from toy_task import ACTION, PARAMETERS, TOY, Unmodelled, simulate

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.discrepancy import FREEDOM, Discrepancy, DiscrepancyScale
from sim.adaptation.method import FAILED, FAILURES, OwnPolicies, Particle, ParticleTrials, Trial
from sim.adaptation.methods import make_method
from sim.adaptation.methods.adaptsim import AdaptSim, forecast_after, is_refuted
from sim.adaptation.outcome_posterior import KEPT, OutcomePosterior, PosteriorPolicy
from sim.adaptation.simulators import Simulators
from sim.errors import NotExecutable
from sim.lab.drawn import drawn_world
from sim.lab.world import load_world
from sim.research.benchmark.sessions import Conditions, estimated_reward, run_session, udr_policies
from sim.research.benchmark.trial_sources import SimulatedTrials
from sim.research.identifiability import errors_left
from sim.rollouts.draws import cover
from sim.solvers.solver import policy_for
from sim.tasks import get_task

FAR_TASK = get_task("pendulum")
FAR = drawn_world(FAR_TASK, seed=1, number=34)
CONTEXTS = TOY.context.sample(np.random.default_rng(5), 16)


@functools.cache
def simulators() -> Simulators:
    return Simulators(trained()[0], reward_table())


def trial(action, effects=None, seed=0):
    return one_trial(action, effects, seed, CONTEXTS[0])


def trials(n, effects=None):
    actions = ACTION.sample(np.random.default_rng(1), n)
    return tuple(trial(action, effects, seed) for seed, action in enumerate(actions))


@functools.cache
def posterior_after(n) -> OutcomePosterior:
    return OutcomePosterior(simulators(), trials(n))


def earned(policy, effects=None):
    actions = policy.actions(CONTEXTS)
    tracks = [simulate(TARGET, c, a, np.zeros(1), effects) for c, a in zip(CONTEXTS, actions, strict=True)]
    return np.mean([TOY.score(t, c) for t, c in zip(tracks, CONTEXTS, strict=True)])


def session(n, effects=None):
    return [tried(TARGET, *trials(n, effects))]


def test_a_discrepancy_follows_its_residuals_nearby_and_forgets_them_far_away():
    known = Discrepancy(DiscrepancyScale(0.0, 0.2), np.array([[0.1, 0.1], [0.15, 0.1]]), np.full(2, 1e-4))
    shown = np.tile([[0.3], [0.3]], (1, 2000))
    drawn = known.drawn(np.array([[0.12, 0.1], [3.0, 3.0]]), shown, seed=0)
    assert drawn[0].mean() == pytest.approx(0.3, abs=0.03)
    assert drawn[0].std() < 0.03
    assert drawn[1].mean() == pytest.approx(0.0, abs=0.03)
    assert drawn[1].std() == pytest.approx(0.2, rel=0.15)
    assert np.array_equal(drawn, known.drawn(np.array([[0.12, 0.1], [3.0, 3.0]]), shown, seed=0))


def test_the_evidence_is_that_of_a_student_t_process():
    known = Discrepancy(DiscrepancyScale(0.1, 0.2), np.array([[0.2], [0.7]]), np.array([0.01, 0.02]))
    covariance = known.scale.kernel(known.at, known.at) + np.diag(known.noise)
    residuals = np.array([[0.1, -0.3], [0.2, 0.0]])
    expected = multivariate_t(shape=covariance, df=FREEDOM).logpdf(residuals.T)
    found = known.evidence(residuals)
    assert found[1] - found[0] == pytest.approx(expected[1] - expected[0])
    wider = Discrepancy(known.scale.times(2.0), known.at, known.noise)
    other = multivariate_t(shape=wider.scale.kernel(known.at, known.at) + np.diag(known.noise), df=FREEDOM)
    assert wider.evidence(residuals) - found == pytest.approx(other.logpdf(residuals.T) - expected)


@pytest.mark.long
def test_one_success_far_from_where_all_simulators_put_it_does_not_choose_among_them():
    strange = trial(ACTION.denormalise(np.full(2, 0.5)))
    assert strange.end_state is not None
    shifted = dataclasses.replace(strange, end_state=strange.end_state + 100.0 * simulators().end_unit)
    weights = [OutcomePosterior(simulators(), (one, *trials(6))).weights for one in (strange, shifted)]
    effective = [1.0 / (w**2).sum() for w in weights]
    assert effective[1] > 0.3 * effective[0]


@pytest.mark.long
def test_the_scale_of_what_reality_adds_grows_where_trials_contradict_the_simulators():
    agreeing = trials(12)
    some = next(t.end_state for t in agreeing if t.end_state is not None)
    contrary = tuple(dataclasses.replace(t, end_state=some if t.end_state is None else None) for t in agreeing)
    scales = [OutcomePosterior(simulators(), seen)._discrepancies[0][0].scale.local for seen in (agreeing, contrary)]
    assert scales[0] < scales[1]


@pytest.mark.long
def test_trials_single_out_the_simulators_that_predict_them():
    before, after = posterior_after(0), posterior_after(12)
    truth = PARAMETERS.normalise(TARGET)
    off = [np.abs(PARAMETERS.normalise(r.parameters) - truth).mean(axis=0) for r in (before, after)]
    assert off[1][0] < 0.5 * off[0][0], "friction moves the piece, so trajectories show it"
    assert after.weights.sum() == pytest.approx(1.0)
    assert after.parameters.shape == (KEPT, 4)


@pytest.mark.long
def test_the_policy_suits_the_target_and_knows_what_it_earns():
    policy = PosteriorPolicy(posterior_after(12))
    assert earned(policy) > 0.9
    mean, low, high = policy.predict(CONTEXTS[0])
    assert low <= mean <= high
    assert mean == pytest.approx(earned(policy), abs=0.15)


def test_what_no_parameter_expresses_is_learnt_as_a_correction_of_the_action():
    tilted = Unmodelled(pitch_bias_rad=-0.09)
    history = session(16, tilted)
    method = AdaptSim(simulators())
    joined = method.final(history)
    by_parameters = max(
        earned(policy_for(simulators().solver, e[None]), tilted) for e in simulators().reward_table.candidates[::4]
    )
    assert earned(joined, tilted) >= by_parameters - 0.02
    _, found = method.assess(history)
    assert found.correction[0] != pytest.approx(0.0, abs=1e-3)


@pytest.mark.long
def test_a_session_is_done_after_two_iterations_and_not_before():
    for_e = policy_for(simulators().solver, TARGET[None])
    found = {n: forecast_after(posterior_after(4 * n), for_e, n) for n in (0, 1, 2, 4)}
    assert not found[0].done
    assert found[1].untried
    assert not found[1].done, "one iteration never tries the policy that it ends with"
    assert found[2].done
    assert found[4].done
    assert not forecast_after(posterior_after(8), for_e, 2, refuted=True).done
    for one in found.values():
        assert not one.hopeless
        assert one.ci95[0] <= one.reward <= one.ci95[1]
    width = {n: one.ci95[1] - one.ci95[0] for n, one in found.items()}
    assert width[4] < width[0], "trials narrow the expected reward"


@pytest.mark.parametrize(
    ("rewards", "predicted", "goes_on"),
    [((0.0, 0.0), 0.7, True), ((0.0, 0.8), 0.7, False), ((0.0, 0.0), np.nan, False)],
)
def test_an_iteration_that_refutes_its_policy_is_not_the_last(rewards, predicted, goes_on):
    tried = [dataclasses.replace(t, reward=r, predicted=predicted) for t, r in zip(trials(2), rewards, strict=True)]
    leading = ParticleTrials(Particle(TARGET[None]), tuple(tried))
    assert is_refuted(leading) is goes_on


@pytest.mark.long
def test_a_session_is_hopeless_after_twelve_failures_in_a_row_and_not_before():
    """The twelve are the latest ones: a success among them ends the count."""
    for_e, seen = policy_for(simulators().solver, TARGET[None]), np.full(TOY.observation.size, 0.5)
    action = ACTION.middle
    failed = Trial(CONTEXTS[0], action, seen, 0.0, None)

    def after(*tried: Trial) -> bool:
        found = forecast_after(OutcomePosterior(simulators(), tried), for_e, 1)
        return found.failures >= FAILURES

    worked = next(trial for trial in trials(12) if trial.reward > FAILED)
    assert after(worked, *[failed] * 12)
    assert not after(*[failed] * 11)
    assert not after(*[failed] * 11, worked, failed)


@pytest.mark.long
def test_an_object_that_nothing_suits_is_called_hopeless():
    actions, seen = cover(ACTION, 96, np.random.default_rng(2)), np.full(TOY.observation.size, 0.5)
    failing = tuple(Trial(CONTEXTS[0], action, seen, 0.0, None) for action in actions)
    found = forecast_after(OutcomePosterior(simulators(), failing), policy_for(simulators().solver, TARGET[None]), 5)
    assert found.hopeless
    assert found.ci95[1] < 0.4
    assert found.done


def optimism(policy):
    assert isinstance(policy, PosteriorPolicy)
    return policy.optimism


def test_the_first_particle_is_cautious_and_the_others_explore_until_they_confirm():
    method, rng = AdaptSim(simulators()), np.random.default_rng(0)
    assert isinstance(method, OwnPolicies)
    first, other = method.start(2, rng)
    assert optimism(method.policy(first, [])) < 0.0
    assert optimism(method.policy(other, [])) > 0.0
    history = session(12) * 4
    first, other = method.next(history, rng)[0], method.start(2, rng)[1]
    assert optimism(method.policy(first, history)) < 0.0
    assert optimism(method.policy(other, history)) == 0.0
    assert optimism(method.final(history)) < 0.0


def test_while_every_trial_has_failed_all_particles_explore_and_the_surest_failure_is_not_preferred():
    method, rng = AdaptSim(simulators()), np.random.default_rng(0)
    failed = tuple(dataclasses.replace(t, reward=0.0, end_state=None) for t in trials(2))
    history = [tried(TARGET, *failed)] * 5
    first, other = method.next(history, rng)[0], method.start(2, rng)[1]
    assert optimism(method.policy(first, history)) > 0.0
    assert optimism(method.policy(other, history)) > optimism(method.policy(first, history))
    assert optimism(method.final(history)) == 0.0


def test_actions_that_the_arm_cannot_do_are_passed_over():
    posterior = posterior_after(0)
    best = PosteriorPolicy(posterior)(CONTEXTS[0])
    other = PosteriorPolicy(posterior, executable=lambda _, action: not np.allclose(action, best))(CONTEXTS[0])
    assert not np.allclose(other, best)
    with pytest.raises(NotExecutable, match="move the toy piece"):
        PosteriorPolicy(posterior, executable=lambda *_: False)(CONTEXTS[0])


@pytest.mark.long
def test_in_the_pendulum_it_ends_far_above_udr_and_every_session_is_the_same():
    task = get_task("pendulum")
    checkpoint = load_checkpoint(task)
    place, conditions = SimulatedTrials(checkpoint.solver, load_world("ood-4", task)), Conditions(budget=8)
    runs = [
        run_session(checkpoint.solver, make_method("adaptsim", task, checkpoint), place, conditions, 0)[-1].actions(
            np.zeros((1, 0))
        )
        for _ in range(2)
    ]
    assert np.array_equal(runs[0], runs[1])
    udr = np.mean(
        [estimated_reward(task, p.actions, place, conditions, 0).mean for p in udr_policies(checkpoint.solver, 0)]
    )
    assert estimated_reward(task, lambda c: np.tile(runs[0], (len(c), 1)), place, conditions, 0).mean > udr + 0.3


@pytest.mark.long
def test_parameters_that_move_the_piece_are_told_and_others_are_not():
    known = simulators()
    left = dict(zip(known.task.parameters.names, errors_left(known, 0), strict=True))
    assert left["mu"] < 0.7
    assert left["mu"] < left["h"]


def test_a_pendulum_whose_first_policies_cost_forty_times_the_least_is_balanced_after_four_trials():
    checkpoint = load_checkpoint(FAR_TASK)
    method, place = make_method("adaptsim", FAR_TASK, checkpoint), SimulatedTrials(checkpoint.solver, FAR)
    assert isinstance(method, AdaptSim)
    assert method.simulators.end_unit > 1e-3, "a unit of 0 would turn every residual into an enormous one"
    policy = run_session(checkpoint.solver, method, place, Conditions(4), seed=0)[-1]
    assert estimated_reward(FAR_TASK, policy.actions, place, Conditions(4), seed=0).mean > 0.9
