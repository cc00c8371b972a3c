"""The baselines of the paper as methods: what each of them looks at, and that it does what it is for."""

from typing import Any

import numpy as np
import pytest
import torch
from toy_learning import TARGET, reward_table, trained
from toy_learning import trial as one_trial
from toy_task import ACTION, PARAMETERS, TOY, simulate

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.method import OwnPolicies, Particle, ParticleTrials
from sim.adaptation.methods import make_method
from sim.errors import ExtraMissing, NotExecutable
from sim.research.methods import search, sysid
from sim.research.methods.learn_in_target import LearnInTarget
from sim.research.methods.search import BayesianOptimisation, BoPrior
from sim.research.methods.sysid import SysId
from sim.solvers.misfit import squares
from sim.tasks import get_task

MIDDLE = ACTION.denormalise(np.array([0.5, 0.5]))


def solver():
    return trained()[0]


def trial(parameters=TARGET, action=MIDDLE, **more):
    return one_trial(action, parameters=parameters, **more)


def tried(unit, trials):
    return ParticleTrials(Particle(PARAMETERS.denormalise(np.asarray(unit, dtype=float))[None]), tuple(trials))


def two_iterations(parameters=TARGET):
    """Two trials of each of two particles, twice."""
    trials = [trial(parameters, seed=s) for s in range(8)]
    particle = Particle(PARAMETERS.denormalise(np.full(4, 0.5))[None])
    return [
        tuple(ParticleTrials(particle, tuple(trials[4 * i + 2 * j : 4 * i + 2 * j + 2])) for j in range(2))
        for i in range(2)
    ]


@pytest.mark.long
def test_the_posterior_finds_the_truth_and_narrows_with_every_iteration():
    method, history = SysId(solver(), ends_only=False, point=False), two_iterations()
    once, twice = method.posterior(history[:1]), method.posterior(history)
    assert once.shape == twice.shape == (sysid.SIMULATED, 4)
    assert ((twice >= 0.0) & (twice < 1.0)).all()
    assert twice[:, 0].mean() == pytest.approx(0.85, abs=0.08)
    assert twice[:, 0].std() < once[:, 0].std() < 0.2 < np.sqrt(1 / 12)
    assert twice[:, 3].std() < 0.25


@pytest.mark.long
def test_all_particles_are_the_posterior_and_the_point_is_its_mean():
    history = two_iterations()
    full, point = (SysId(solver(), ends_only=False, point=p) for p in (False, True))
    samples = [p.samples for p in full.next(history, np.random.default_rng(0))]
    assert len(samples) == 2
    assert np.array_equal(samples[0], samples[1])
    assert samples[0].shape == (sysid.SAMPLES, 4)
    assert all(PARAMETERS.contains(s) for s in samples[0])
    (one, _) = point.next(history, np.random.default_rng(0))
    assert one.samples.shape == (1, 4)
    assert PARAMETERS.normalise(one.mean)[0] == pytest.approx(full.posterior(history)[:, 0].mean())


@pytest.mark.long
def test_another_process_has_the_same_posterior_and_another_trial_another_one():
    history = two_iterations()
    again = [SysId(solver(), ends_only=True, point=False).posterior(history) for _ in range(2)]
    assert np.array_equal(again[0], again[1])
    other = SysId(solver(), ends_only=True, point=False).posterior(two_iterations(PARAMETERS.denormalise(np.zeros(4))))
    assert abs(other[:, 0].mean() - again[0][:, 0].mean()) > 0.3


def test_the_state_variant_sees_only_the_end():
    method = SysId(solver(), ends_only=True, point=False)
    observation = np.arange(TOY.observation.size, dtype=float)
    assert method._seen(observation).tolist() == [6.0, 7.0]
    assert SysId(solver(), ends_only=False, point=False)._seen(observation).tolist() == observation.tolist()


def test_what_is_simulated_for_a_trial_is_what_that_trial_shows():
    """At the truth the simulated trajectories lie around the observed one, as the misfit measures them."""
    method, seen = SysId(solver(), ends_only=False, point=False), trial()
    rng = np.random.default_rng(0)
    unit = np.tile(PARAMETERS.normalise(TARGET), (200, 1))
    shown = method._simulated(unit, seen, rng)
    path = solver().trajectories(TARGET[None], MIDDLE[None], np.zeros((1, 1)), seen.context[None])
    distance = squares(solver(), shown.mean(axis=0), path)
    assert shown.shape == (200, TOY.observation.size)
    assert distance[0] < 1.0
    wrong = method._simulated(np.tile(PARAMETERS.normalise(PARAMETERS.low), (200, 1)), seen, rng)
    assert np.abs(wrong.mean(axis=0) - seen.observation).max() > np.abs(shown.mean(axis=0) - seen.observation).max()


def test_draws_outside_of_the_ranges_do_not_count():
    drawn = np.array([[0.2, 0.3], [1.2, 0.5], [np.nan, 0.1]])
    assert sysid._within(drawn).tolist() == [[0.2, 0.3]]
    assert sysid._within(drawn[1:]).tolist() == [[1.0 - 1e-9, 0.5]]


def test_bayesian_optimisation_goes_where_rewards_are_high():
    method, rng = BayesianOptimisation(TOY), np.random.default_rng(0)

    def reward(unit):
        return float(np.clip(1.0 - 1.5 * np.abs(unit[0] - 0.9), 0.0, 1.0))

    particles = method.start(2, rng)
    history = []
    for _ in range(6):
        units = [PARAMETERS.normalise(p.mean) for p in particles]
        history.append(tuple(tried(u, [trial(reward=reward(u), seed=s) for s in range(2)]) for u in units))
        particles = method.next(history, rng)
    assert [p.samples.shape for p in particles] == [(1, 4)] * 2
    last = [PARAMETERS.normalise(p.mean)[0] for p in particles]
    assert np.mean(last) > 0.6
    assert not np.array_equal(particles[0].mean, particles[1].mean)


def test_bayesian_optimisation_survives_rewards_that_are_all_alike():
    history = [(tried([0.5] * 4, [trial(reward=0.0), trial(reward=0.0)]),)]
    assert len(BayesianOptimisation(TOY).next(history, np.random.default_rng(0))) == 1


def test_torch_draws_as_if_nothing_had_happened():
    torch.manual_seed(3)
    expected = torch.rand(2)
    torch.manual_seed(3)
    search._maximise(np.array([[0.5] * 4]), np.array([0.3]), 0.4, np.random.default_rng(0).random((8, 4)), 1, 5)
    assert torch.equal(torch.rand(2), expected)


def test_the_learnt_prior_is_that_of_past_tasks_and_rewards_correct_it():
    method = BoPrior(TOY, reward_table())
    mean, covariance = method.conditioned([])
    assert np.allclose(mean, reward_table().rewards.mean(axis=1))
    assert covariance.shape == (64, 64)
    first, second = method.start(2, np.random.default_rng(0))
    at = int(np.argmax(mean))
    assert np.array_equal(first.mean, reward_table().candidates[at])
    assert not np.array_equal(first.mean, second.mean)
    bad = [(ParticleTrials(first, tuple(trial(reward=0.0) for _ in range(8))),)]
    after, left = method.conditioned(bad)
    assert after[at] < mean[at] - 0.3
    assert left[at, at] < covariance[at, at]
    moved = method.next(bad, np.random.default_rng(0))[0].mean
    assert not np.array_equal(moved, first.mean)


def test_rewards_of_one_task_lead_to_what_earns_there():
    method, target = BoPrior(TOY, reward_table()), 100
    truth = reward_table().rewards[:, target]
    particles, history = method.start(2, None), []
    for _ in range(5):
        index = [int(np.argmin(np.abs(reward_table().candidates - p.mean).sum(axis=1))) for p in particles]
        history.append(
            tuple(
                ParticleTrials(p, tuple(trial(reward=float(truth[i])) for _ in range(2)))
                for p, i in zip(particles, index, strict=True)
            )
        )
        particles = method.next(history, None)
    chosen = int(np.argmin(np.abs(reward_table().candidates - particles[0].mean).sum(axis=1)))
    assert truth[chosen] > np.quantile(truth, 0.9)


@pytest.mark.long
def test_learning_in_the_target_finds_the_action_without_a_simulator():
    method = LearnInTarget(TOY)
    assert isinstance(method, OwnPolicies)
    rng, history = np.random.default_rng(0), list[Any]()
    particles = method.start(2, rng)
    for _ in range(10):
        seen = []
        for particle in particles:
            policy = method.policy(particle, history)
            trials = [trial(action=policy(c), where=c) for c in TOY.context.sample(rng, 2)]
            seen.append(ParticleTrials(particle, tuple(trials)))
        history.append(tuple(seen))
        particles = method.next(history, rng)
    contexts = TOY.context.sample(rng, 8)

    def earned(policy):
        tracks = [simulate(TARGET, c, a, np.zeros(1)) for c, a in zip(contexts, policy.actions(contexts), strict=True)]
        return np.mean([TOY.score(t, c) for t, c in zip(tracks, contexts, strict=True)])

    assert earned(method.final(history)) > earned(method.final([])) + 0.2
    mean, low, high = method.final(history).predict(contexts[0])
    assert 0.0 <= low <= mean <= high <= 1.0


@pytest.mark.long
def test_its_exploration_differs_by_particle_and_context_and_is_repeated_exactly():
    method = LearnInTarget(TOY)
    first, second = method.start(2, np.random.default_rng(0))
    contexts = TOY.context.sample(np.random.default_rng(1), 4)
    actions = method.policy(first, []).actions(contexts)
    assert len(np.unique(actions, axis=0)) > 1
    assert not np.array_equal(actions, method.policy(second, []).actions(contexts))
    assert np.array_equal(actions, LearnInTarget(TOY).policy(first, []).actions(contexts))


def test_it_proposes_only_what_the_arm_can_do():
    method = LearnInTarget(TOY)
    (particle,) = method.start(1, np.random.default_rng(0))
    slow = method.policy(particle, [], lambda context, action: bool(action[1] < 0.6))
    assert all(slow(c)[1] < 0.6 for c in TOY.context.sample(np.random.default_rng(1), 8))
    with pytest.raises(NotExecutable, match="move the toy piece"):
        method.policy(particle, [], lambda context, action: False)(TOY.reference_context)


def test_a_missing_extra_says_what_to_do(monkeypatch):
    monkeypatch.setattr(search, "find_spec", lambda name: None)
    with pytest.raises(ExtraMissing, match=r"bo needs the package botorch.*pip install .*\[bo\]'$"):
        make_method("bo", TOY, None)
    task = get_task("pendulum")
    with pytest.raises(ExtraMissing, match=r"pip install .*\[sbi\]'$"):
        make_method("sysid-bayes", task, load_checkpoint(task))
