from dataclasses import replace

import numpy as np
import pytest
from toy_learning import iteration, trained
from toy_task import PARAMETERS, TOY, Unmodelled

from sim.adaptation import METHODS, choose_best, make_method, verdict
from sim.adaptation.method import Particle, ParticleTrials, Trial
from sim.adaptation.phase2 import AdaptSim
from sim.adaptation.q_network import new_network
from sim.adaptation.step import adapt, encode_state, state_size
from sim.errors import CheckpointError, UnknownName
from sim.misfit import misfit
from sim.task_policy import EmulatorSolver, train_task_policy

MEAN = PARAMETERS.denormalise(np.array([0.5, 0.5, 0.0, 0.5]))


def network(seed=0):
    return new_network(state_size(TOY), len(TOY.parameters), seed)


def observations(n, seed=0):
    return list(np.random.default_rng(seed).random((n, TOY.observation.size)))


def session(parameters, means, effects=None, iterations=4, policy_for=None):
    """A session on a world: two particles that stay where they are."""
    emulator, _ = trained()
    rng = np.random.default_rng(0)
    history = []
    for _ in range(iterations):
        tried = []
        for mean in means:
            policy = train_task_policy(TOY, emulator, (policy_for if policy_for is not None else mean)[None], rng)
            trials = []
            for context in TOY.context.sample(rng, 2):
                track = TOY.simulate(parameters, context, policy(context), np.zeros(1), effects)
                seen = TOY.observation.with_noise(TOY.observation(track), rng)
                trials.append(Trial(context, policy(context), seen, TOY.score(track, context)))
            tried.append(ParticleTrials(Particle(mean[None]), tuple(trials)))
        history.append(tuple(tried))
    return history


def test_adapt_moves_each_parameter_by_a_step_or_not_at_all():
    q = network()
    moves = set()
    for seed in range(20):
        following = adapt(q, TOY, MEAN, observations(2, seed))
        step = PARAMETERS.normalise(following) - PARAMETERS.normalise(MEAN)
        assert all(min(abs(abs(s) - 0.15), abs(s)) < 1e-9 for s in step[[0, 1, 3]])
        assert step[2] in (0.0, 1.0)
        moves.add(tuple(np.sign(step).astype(int)))
    assert PARAMETERS.contains(adapt(q, TOY, PARAMETERS.high, observations(2)))
    assert not following.flags.writeable


def test_adapt_follows_the_network():
    q = network()
    seen = observations(2)
    state = encode_state(TOY, MEAN[None], np.concatenate(seen)[None])
    expected = PARAMETERS.step(MEAN, q.directions(state)[0], 0.15)
    assert np.array_equal(adapt(q, TOY, MEAN, seen), expected)


def test_adapt_takes_the_last_trials_and_repeats_a_single_one():
    q = network()
    three = observations(3)
    assert np.array_equal(adapt(q, TOY, MEAN, three), adapt(q, TOY, MEAN, three[1:]))
    assert np.array_equal(adapt(q, TOY, MEAN, three[:1]), adapt(q, TOY, MEAN, [three[0], three[0]]))
    with pytest.raises(ValueError, match="at least one trial"):
        adapt(q, TOY, MEAN, [])


def test_adaptsim_starts_apart_and_moves_each_particle_on_its_own():
    method = AdaptSim(TOY, network())
    one, two = method.start(2, np.random.default_rng(0))
    assert PARAMETERS.contains(one.mean)
    assert PARAMETERS.contains(two.mean)
    assert np.linalg.norm(PARAMETERS.normalise(one.mean) - PARAMETERS.normalise(two.mean)) > 0.5
    history = [iteration((one.mean, [0.0, 1.0]), (two.mean, []))]
    after = method.next(history, np.random.default_rng(9))
    zeros = [np.zeros(TOY.observation.size)] * 2
    assert np.array_equal(after[0].mean, adapt(method.network, TOY, one.mean, zeros))
    assert np.array_equal(after[1].mean, two.mean)


def test_udr_covers_omega_and_never_changes():
    method = make_method("udr", TOY, None)
    particles = method.start(2, np.random.default_rng(0))
    samples = particles[0].samples
    assert len(samples) >= 32
    assert np.isclose(PARAMETERS.normalise(samples).mean(axis=0), 0.5, atol=0.05).all()
    history = [tuple(ParticleTrials(p, ()) for p in particles)]
    assert [p.samples.tolist() for p in method.next(history, np.random.default_rng(3))] == [
        p.samples.tolist() for p in particles
    ]


def test_random_search_stays_away_from_what_was_tried():
    method = make_method("random", TOY, None)
    rng = np.random.default_rng(0)
    tried = list(method.start(2, rng))
    for _ in range(4):
        history = [tuple(ParticleTrials(p, ()) for p in tried)]
        history = [history[0][:-2], history[0][-2:]] if len(tried) > 2 else history
        tried += method.next(history, rng)
    unit = PARAMETERS.normalise(np.array([p.mean for p in tried]))
    gaps = np.linalg.norm(unit[:, None] - unit[None], axis=-1) + 10.0 * np.eye(len(unit))
    assert gaps.min() > 0.3


def test_every_registered_method_can_be_made_or_says_what_it_needs():
    assert {"adaptsim", "random", "udr"} <= METHODS.keys()
    with pytest.raises(UnknownName, match="adaptsim"):
        make_method("adaptsym", TOY, None)
    with pytest.raises(CheckpointError, match="pretrain --task toy"):
        make_method("adaptsim", TOY, None)


def test_best_pools_neighbours_instead_of_trusting_two_lucky_trials():
    def mean(u):
        return PARAMETERS.denormalise(np.array([u, 0.5, 0.0, 0.5]))

    lucky = iteration((mean(0.0), [0.9, 1.0]), (mean(0.05), [0.0, 0.1]))
    more_bad_neighbours = iteration((mean(0.1), [0.1, 0.0]), (mean(0.8), [0.8, 0.9]))
    good_neighbours = iteration((mean(0.85), [0.85, 0.8]), (mean(0.9), [0.8, 0.85]))
    best = choose_best(TOY, [lucky, more_bad_neighbours, good_neighbours])
    assert PARAMETERS.normalise(best.particle.mean)[0] > 0.7
    assert best.trials == 6
    assert 0.0 <= best.ci95[0] < best.mean_reward < best.ci95[1] <= 1.0


def test_more_trials_narrow_the_interval_and_shrink_less():
    few = choose_best(TOY, [iteration((MEAN, [0.9, 0.9]))])
    many = choose_best(TOY, [iteration((MEAN, [0.9, 0.9])) for _ in range(20)])
    assert few.mean_reward < many.mean_reward < 0.9
    assert many.ci95[1] - many.ci95[0] < 0.5 * (few.ci95[1] - few.ci95[0])
    assert many.trials == 40
    with pytest.raises(ValueError, match="no trial"):
        choose_best(TOY, [])


def test_misfit_is_small_for_the_simulators_own_and_large_for_others():
    emulator, _ = trained()
    rng = np.random.default_rng(0)
    own, other = [], []
    for parameters in PARAMETERS.sample(rng, 20):
        context, action = TOY.context.sample(rng, 1)[0], TOY.action.sample(rng, 1)[0]
        for values, effects in ((own, None), (other, Unmodelled(wind_m=0.15))):
            track = TOY.simulate(parameters, context, action, np.zeros(1), effects)
            values.append(
                misfit(
                    EmulatorSolver(emulator), context, action, TOY.observation.with_noise(TOY.observation(track), rng)
                )
            )
    assert np.mean(np.array(own) < 1.5 * emulator.misfit_limit) >= 0.9
    assert min(other) > 1.5 * emulator.misfit_limit


def test_the_verdict_says_what_the_data_say():
    emulator, _ = trained()
    good = session(MEAN, [MEAN, PARAMETERS.step(MEAN, np.array([1, 0, 0, 0]), 0.15)])
    assert verdict(TOY, good, EmulatorSolver(emulator)).startswith("Converged")
    failing = tuple(replace(s, trials=tuple(replace(t, reward=0.0) for t in s.trials)) for s in good[-1])
    assert verdict(TOY, [*good, *good, *good, failing], EmulatorSolver(emulator)).startswith("Not converged")
    assert verdict(TOY, good[:1], EmulatorSolver(emulator)).startswith("Too few trials")
    windy = verdict(TOY, session(MEAN, [MEAN, MEAN], Unmodelled(wind_m=0.2)), EmulatorSolver(emulator))
    assert "the simulator cannot express this toy piece: 16 of 16" in windy
    far = PARAMETERS.denormalise(np.array([1.0, 0.5, 1.0, 1.0]))
    bad = session(far, [PARAMETERS.low, PARAMETERS.low])
    assert verdict(TOY, bad, EmulatorSolver(emulator)).startswith("Reward stays low")
