import dataclasses

import numpy as np
import pytest
from toy_learning import roll, train_one, trained
from toy_task import PARAMETERS, TOY, best_action

from sim.adaptation.methods.udr import Udr
from sim.errors import NotExecutable
from sim.rollouts.draws import trial_requests
from sim.solvers.solver import policy_for

CONTEXT = TOY.reference_context


def distance(action, parameters):
    return np.linalg.norm(TOY.action.normalise(action) - best_action(parameters))


def true_reward(policy, parameters, n=64):
    rng = np.random.default_rng(1)
    contexts = TOY.context.sample(rng, n)
    requests = trial_requests(TOY, np.tile(parameters, (n, 1)), contexts, policy.actions(contexts), rng)
    return roll(requests).rewards(TOY, contexts).mean()


def test_policies_find_the_best_action_of_their_parameters():
    emulator, _ = trained()
    means = TOY.parameters.sample(np.random.default_rng(0), 12)
    policies = emulator.policies(means[:, None, :], np.random.default_rng(1))
    errors = [distance(policy(CONTEXT), mean) for policy, mean in zip(policies, means, strict=True)]
    assert np.median(errors) < 0.06
    assert max(errors) < 0.2
    assert all(TOY.action.contains(policy(CONTEXT)) for policy in policies)


def test_one_and_many_give_the_same_and_repeat_exactly():
    emulator, _ = trained()
    means = TOY.parameters.sample(np.random.default_rng(0), 3)
    many = emulator.policies(means[:, None, :], np.random.default_rng(1))
    for policy, mean in zip(many, means, strict=True):
        alone = train_one(emulator, mean[None], np.random.default_rng(1))
        assert np.array_equal(alone(CONTEXT), policy(CONTEXT))
        assert np.array_equal(policy.actions(CONTEXT[None])[0], policy(CONTEXT))


def test_a_policy_over_all_of_omega_compromises():
    emulator, _ = trained()
    samples = Udr(TOY).start(1, np.random.default_rng(0))[0].samples
    wide = train_one(emulator, samples, np.random.default_rng(1))
    assert np.abs(TOY.action.normalise(wide(CONTEXT)) - np.array([0.5, 0.5])).max() < 0.25
    corner = TOY.parameters.low
    narrow = train_one(emulator, corner[None], np.random.default_rng(1))
    assert true_reward(narrow, corner) > true_reward(wide, corner) + 0.1


def test_the_prediction_for_the_operator_agrees_with_rollouts():
    emulator, _ = trained()
    mean = TOY.parameters.denormalise(np.array([0.3, 0.5, 1.0, 0.6]))
    policy = train_one(emulator, mean[None], np.random.default_rng(1))
    expected, low, high = policy.predict(CONTEXT)
    assert 0.0 <= low <= expected <= high <= 1.0
    assert expected == pytest.approx(true_reward(policy, mean), abs=0.08)


def test_only_executable_actions_are_proposed():
    emulator, _ = trained()
    mean = TOY.parameters.denormalise(np.array([0.9, 0.5, 0.0, 0.6]))
    free = train_one(emulator, mean[None], np.random.default_rng(1))
    limit = free(CONTEXT)[0] - 0.02
    bound = train_one(
        emulator, mean[None], np.random.default_rng(1), executable=lambda context, action: action[0] < limit
    )
    assert limit - 0.04 < bound(CONTEXT)[0] < limit
    never = dataclasses.replace(bound, executable=lambda context, action: False)
    with pytest.raises(NotExecutable, match="none of the 64 best actions"):
        never(CONTEXT)


def test_expected_reward_ranks_targets_like_rollouts():
    emulator, _ = trained()
    rng = np.random.default_rng(3)
    targets = TOY.parameters.sample(rng, 24)
    policy = train_one(emulator, targets[:1], rng)
    contexts = TOY.context.sample(rng, 4)
    actions = np.tile(policy.actions(contexts), (24, 1, 1))
    emulated = emulator.expected_rewards(targets, contexts, actions, rng)
    true = np.array([true_reward(policy, target) for target in targets])
    assert np.corrcoef(emulated, true)[0, 1] > 0.9


def test_the_same_distribution_has_the_same_policy():
    solver, mean = trained()[0], PARAMETERS.denormalise(np.array([0.3, 0.6, 1.0, 0.2]))
    one, again = (policy_for(solver, mean[None]) for _ in range(2))
    contexts = TOY.context.sample(np.random.default_rng(0), 6)
    assert np.array_equal(one.actions(contexts), again.actions(contexts))
    other = policy_for(solver, mean[None], seed=1)
    assert not np.array_equal(one.actions(contexts), other.actions(contexts))
