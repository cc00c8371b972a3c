import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from documents import install
from toy_learning import iteration, train_one, trained, tried
from toy_task import PARAMETERS, TOY, Unmodelled

from adaptsim_cli.bench.doctor import checks
from hw import plugins
from sim.adaptation import methods
from sim.adaptation.judging import Misfits, assess, choose_best, final_policy, verdict_of
from sim.adaptation.method import Best, Particle, ParticleTrials, SessionForecast, Trial
from sim.adaptation.methods import make_method
from sim.adaptation.verdict import Kind, Reason
from sim.errors import CheckpointError, UnknownName
from sim.research.methods.q_policy import QPolicy, encode, inputs, look_back, new_policy, seen_in_session
from sim.solvers.misfit import misfit

MEMORIES = ["iteration", "state", "history"]
AIMED = replace(TOY, goal_m=lambda context: context)  # its contexts are goals
MEAN = PARAMETERS.denormalise(np.array([0.5, 0.5, 0.0, 0.5]))


def network(seed=0):
    return new_policy(TOY, "iteration", seed)


def observations(n, seed=0):
    return list(np.random.default_rng(seed).random((n, TOY.observation.size)))


def session(parameters, means, effects=None, iterations=4, policy_for=None):
    """A session on a world: two particles that stay where they are."""
    emulator, _ = trained()
    rng = np.random.default_rng(0)
    history = []
    for _ in range(iterations):
        of_all = list[ParticleTrials]()
        for mean in means:
            policy = train_one(emulator, (policy_for if policy_for is not None else mean)[None], rng)
            trials = []
            for context in TOY.context.sample(rng, 2):
                track = TOY.simulate(parameters, context, policy(context), np.zeros(1), effects)
                seen = TOY.observation.with_noise(TOY.observation(track), rng)
                trials.append(Trial(context, policy(context), seen, TOY.score(track, context), TOY.end_of(track)))
            of_all += tried(mean, *trials)
        history.append(tuple(of_all))
    return history


def visited(mean, seen, rewards=(0.0, 0.0)):
    """A session of one particle and one iteration: its mean, observations and rewards."""
    trials = tuple(Trial(np.zeros(2), np.zeros(2), o, r, None) for o, r in zip(seen, rewards, strict=False))
    return [tried(mean, *trials)]


def moved(method, history):
    return method.next(history, np.random.default_rng(0))[0].mean


@pytest.mark.parametrize("memory", MEMORIES)
def test_adaptsim_moves_each_parameter_by_a_step_or_not_at_all(memory):
    method = QPolicy(TOY, new_policy(TOY, memory, 0), memory)
    moves = set()
    for seed in range(20):
        following = moved(method, visited(MEAN, observations(2, seed)))
        step = PARAMETERS.normalise(following) - PARAMETERS.normalise(MEAN)
        assert all(min(abs(abs(s) - 0.15), abs(s)) < 1e-9 for s in step[[0, 1, 3]])
        assert step[2] in (0.0, 1.0)
        moves.add(tuple(np.sign(step).astype(int)))
    assert PARAMETERS.contains(moved(method, visited(PARAMETERS.high, observations(2))))


def test_the_papers_policy_sees_the_mean_and_the_last_iteration():
    method, seen = QPolicy(TOY, network()), observations(2)
    state = np.concatenate([PARAMETERS.normalise(MEAN), *seen])[None]
    expected = PARAMETERS.step(MEAN, method.network.directions(state)[0], 0.15)
    assert np.array_equal(moved(method, visited(MEAN, seen)), expected)
    before = visited(PARAMETERS.low, observations(2, 5), (1.0, 1.0))
    assert np.array_equal(moved(method, before + visited(MEAN, seen, (1.0, 0.0))), expected)


def test_the_state_only_policy_sees_how_the_last_trials_ended():
    method, seen = QPolicy(TOY, new_policy(TOY, "state", 0), "state"), observations(2)
    state = np.concatenate([PARAMETERS.normalise(MEAN), *[o[-2:] for o in seen]])[None]
    expected = PARAMETERS.step(MEAN, method.network.directions(state)[0], 0.15)
    assert np.array_equal(moved(method, visited(MEAN, seen)), expected)


def test_the_last_trials_count_and_a_single_one_is_repeated():
    method, three = QPolicy(TOY, network()), observations(3)
    rewards = (0.0, 0.0, 0.0)
    assert np.array_equal(
        moved(method, visited(MEAN, three, rewards)), moved(method, visited(MEAN, three[1:], rewards))
    )
    assert np.array_equal(moved(method, visited(MEAN, three[:1])), moved(method, visited(MEAN, [three[0], three[0]])))


def test_a_history_holds_parameters_observations_rewards_and_ages_of_all_particles():
    one = iteration((PARAMETERS.low, [0.1, 0.2]), (PARAMETERS.high, [0.3, 0.4]))
    two = iteration((MEAN, [0.5, 0.6]), (PARAMETERS.high, []))
    seen = seen_in_session(TOY, [one, two], 0)
    assert seen.rewards[0].tolist() == [[0.5, 0.6], [0.1, 0.2], [0.3, 0.4]]
    assert seen.own[0].tolist() == [1.0, 1.0, 0.0]
    assert seen.age[0].tolist() == [0.0, 1.0, 1.0]
    assert np.array_equal(seen.means[0], [MEAN, PARAMETERS.low, PARAMETERS.high])
    with pytest.raises(ValueError, match="at least one trial"):
        seen_in_session(TOY, [one, two], 1)


@pytest.mark.parametrize("task", [TOY, AIMED])
@pytest.mark.parametrize("memory", MEMORIES)
def test_training_and_session_see_the_same(task, memory):
    rng = np.random.default_rng(0)
    size, p = task.observation.size, len(PARAMETERS)
    means = PARAMETERS.denormalise(rng.random((1, 2, 3, p)))
    seen, rewards = rng.random((1, 2, 3, 2 * size)), rng.random((1, 2, 3, 2))
    contexts = task.context.sample(rng, 12).reshape(1, 2, 3, 2, -1)
    history = [
        tuple(
            ParticleTrials(
                Particle(means[0, j, k][None]),
                tuple(
                    Trial(c, np.zeros(2), o, float(r), None)
                    for c, o, r in zip(contexts[0, j, k], seen[0, j, k].reshape(2, size), rewards[0, j, k], strict=True)
                ),
            )
            for j in range(2)
        )
        for k in range(3)
    ]
    goals = task.context.normalise(contexts).reshape(1, 2, 3, -1)
    trained = encode(task, memory, look_back(means, seen, goals, rewards))
    lived = np.concatenate([encode(task, memory, seen_in_session(task, history, j)) for j in range(2)])
    assert np.allclose(trained, lived)
    assert trained.shape == (2, np.prod(inputs(task, memory)))
    without = encode(task, memory, look_back(means, seen, 0.5 + 0.0 * goals, rewards))
    assert np.array_equal(trained, without) == (task.goal_m is None)


def test_the_order_of_older_entries_does_not_matter_to_the_network():
    q = new_policy(TOY, "history", 1)
    slots = np.random.default_rng(0).random((1, q.slots, q.inputs))
    slots[..., -1] = 1.0
    swapped = slots[:, [0, 2, 1, *range(3, q.slots)]]
    empty = slots.copy()
    empty[:, 1:, -1] = 0.0
    out = [q(x.reshape(1, -1)) for x in (slots, swapped, empty)]
    assert np.allclose(out[0], out[1], atol=1e-5)
    assert not np.allclose(out[0], out[2], atol=1e-3)


def test_adaptsim_starts_apart_and_a_particle_without_trials_stays():
    method = QPolicy(TOY, network())
    one, two = method.start(2, np.random.default_rng(0))
    assert PARAMETERS.contains(one.mean)
    assert PARAMETERS.contains(two.mean)
    assert np.linalg.norm(PARAMETERS.normalise(one.mean) - PARAMETERS.normalise(two.mean)) > 0.5
    history = [iteration((one.mean, [0.0, 1.0]), (two.mean, []))]
    after = method.next(history, np.random.default_rng(9))
    assert np.array_equal(after[0].mean, moved(method, visited(one.mean, [np.zeros(TOY.observation.size)] * 2)))
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


@pytest.mark.parametrize("name", ["adaptsim", "adaptsim-belief", "adaptsim-iteration", "bo-prior", "sysid-bayes-point"])
def test_a_method_without_its_checkpoint_and_an_unknown_one_say_what_they_need(name):
    with pytest.raises(CheckpointError, match="pretrain --task toy"):
        make_method(name, TOY, None)
    with pytest.raises(UnknownName, match="did you mean adaptsim"):
        make_method("adaptsym", TOY, None)


class FirstForever:
    """A method that keeps the particle it began with, whatever it earned."""

    def start(self, n, rng):
        return tuple(Particle(PARAMETERS.sample(rng, 1)) for _ in range(n))

    def next(self, history, rng):
        return self.start(len(history[-1]), rng)

    def choose(self, history):
        first = history[0][0]
        return Best(first.particle, 0.25, (0.0, 0.5), len(first.trials))


@pytest.mark.long
def test_a_method_may_choose_what_its_session_keeps():
    emulator, _ = trained()
    other = PARAMETERS.denormalise(np.array([0.9, 0.5, 0.0, 0.5]))
    history = [iteration((MEAN, [0.0, 0.1]), (other, [1.0, 1.0]))]
    udr = make_method("udr", TOY, None)
    assert np.array_equal(assess(udr, TOY, history)[0].particle.mean, other)
    best, forecast = assess(FirstForever(), TOY, history)
    assert (best.particle.mean.tolist(), best.mean_reward, forecast) == (MEAN.tolist(), 0.25, None)
    final = final_policy(FirstForever(), emulator, TOY, history)
    context = TOY.reference_context
    assert np.array_equal(final(context), train_one(emulator, MEAN[None], np.random.default_rng(0))(context))


def test_a_method_may_come_from_a_package(tmp_path, monkeypatch):
    code = "from test_methods import FirstForever\n\ndef create(task, checkpoint):\n    return FirstForever()\n"
    (tmp_path / "first_forever.py").write_text(code, encoding="utf-8")
    install(
        tmp_path, "first-forever", {"first": "first_forever", "torn": "first_forever:nothing"}, methods.REGISTRY.group
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, "test_methods", sys.modules[__name__])
    plugins.offers.cache_clear()
    try:
        assert methods.method_names()[-2:] == ("first", "torn")
        assert isinstance(make_method("first", TOY, None), FirstForever)
        with pytest.raises(UnknownName, match=r"torn of first-forever 1\.0 .* has no nothing"):
            make_method("torn", TOY, None)
        assert "method torn of first-forever" in checks.CHECKS["plug-ins"].probe(None).detail
    finally:
        plugins.offers.cache_clear()


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
    own, other = list[Any](), list[Any]()
    for parameters in PARAMETERS.sample(rng, 20):
        context, action = TOY.context.sample(rng, 1)[0], TOY.action.sample(rng, 1)[0]
        for values, effects in ((own, None), (other, Unmodelled(wind_m=0.15))):
            track = TOY.simulate(parameters, context, action, np.zeros(1), effects)
            values.append(misfit(emulator, context, action, TOY.observation.with_noise(TOY.observation(track), rng)))
    assert np.mean(np.array(own) < 1.5 * emulator.misfit_limit) >= 0.9
    assert min(other) > 1.5 * emulator.misfit_limit


def judged(history, forecast=None):
    return verdict_of(TOY, history, Misfits(trained()[0]), choose_best(TOY, history), forecast)


def test_the_verdict_follows_from_the_data():
    good = session(MEAN, [MEAN, PARAMETERS.step(MEAN, np.array([1, 0, 0, 0]), 0.15)])
    assert judged(good).kind is Kind.CONVERGED
    failing = tuple(replace(s, trials=tuple(replace(t, reward=0.0) for t in s.trials)) for s in good[-1])
    assert judged([*good, *good, *good, failing]).kind is Kind.NOT_CONVERGED
    assert judged(good[:1]).kind is Kind.TOO_FEW
    windy = judged(session(MEAN, [MEAN, MEAN], Unmodelled(wind_m=0.2)))
    assert windy.is_inexpressible and (windy.strange, windy.trials) == (16, 16)
    far = PARAMETERS.denormalise(np.array([1.0, 0.5, 1.0, 1.0]))
    assert judged(session(far, [PARAMETERS.low, PARAMETERS.low])).kind is Kind.STAYS_LOW


def test_good_rewards_are_said_to_be_good_whether_or_not_the_parameters_rest():
    def earning(reward, step):
        mean = PARAMETERS.step(MEAN, np.array([step, 0, 0, 0]), 0.15)
        (part,) = session(MEAN, [mean, mean], iterations=1)
        return tuple(replace(s, trials=tuple(replace(t, reward=reward) for t in s.trials)) for s in part)

    good = [earning(0.9, 0), earning(0.9, 0)]
    assert (judged(good).kind, judged(good).reasons) == (Kind.CONVERGED, ())
    moving = judged([*good, earning(0.9, 2)])
    assert (moving.kind, moving.reasons) == (Kind.NOT_CONVERGED, (Reason.MOVING,))
    full = judged([*good, earning(1.0, 2)])
    assert (full.kind, full.reasons) == (Kind.CONVERGED, (Reason.FULL,))


def test_a_policy_that_nobody_has_tried_is_never_enough():
    history = session(MEAN, [MEAN])
    forecast = SessionForecast(0.9, (0.7, 1.0), 0, untried=True, correction=np.zeros(2), correction_std=np.zeros(2))
    first = judged(history, forecast)
    assert (first.kind, first.reasons) == (Kind.GO_ON, (Reason.UNTRIED,))
    assert judged(history, replace(forecast, untried=False)).kind is Kind.ENOUGH
    assert judged(history, replace(forecast, ci95=(0.0, 0.1), reward=0.05)).kind is Kind.HOPELESS
