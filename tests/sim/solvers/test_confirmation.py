import dataclasses
from typing import Any

import numpy as np
import pytest
from toy_learning import roll, trained
from toy_task import TOY, best_action

from sim.errors import NotExecutable
from sim.solvers.confirmation import SCENARIOS, WINNERS, ConfirmedPolicy, ConfirmingPolicies
from sim.solvers.solver import policy_for

CONTEXT = TOY.reference_context
MEAN = TOY.parameters.denormalise(np.array([0.4, 0.5, 0.0, 0.6]))


def confirmed(rolls=roll, executable=None, mean=MEAN):
    policy = policy_for(ConfirmingPolicies(trained()[0], rolls), mean[None], executable)
    assert isinstance(policy, ConfirmedPolicy)
    return policy


def test_the_best_of_the_winners_by_true_rollouts_is_taken():
    asked = []

    def only_the_third_works(requests):
        asked.append(requests)
        results = roll(requests)
        third = np.zeros(len(requests), dtype=bool)
        third[2 * SCENARIOS : 3 * SCENARIOS] = True
        return dataclasses.replace(results, succeeded=third)

    policy = confirmed(only_the_third_works)
    shortlist, _ = policy.policy.shortlist(CONTEXT, WINNERS)
    assert np.array_equal(policy(CONTEXT), shortlist[2])
    assert len(asked[0]) == WINNERS * SCENARIOS
    policy.predict(CONTEXT)
    assert len(asked) == 1  # a context is confirmed once


def test_the_winners_lie_apart_and_the_first_is_the_emulators_own():
    policy = confirmed()
    shortlist, expected = policy.policy.shortlist(CONTEXT, WINNERS)
    unit = TOY.action.normalise(shortlist)
    gaps = np.linalg.norm(unit[:, None] - unit[None], axis=-1) + np.eye(len(unit))
    assert gaps.min() >= 0.1
    assert np.array_equal(shortlist[0], policy.policy(CONTEXT))
    assert expected[0] >= expected.max() - 0.1


def test_a_confirmed_policy_is_no_worse_and_knows_what_it_earns():
    means = TOY.parameters.sample(np.random.default_rng(3), 20)
    plain, sure, said = list[float](), list[float](), list[Any]()
    for mean in means:
        policy = confirmed(mean=mean)
        for rewards, action in ((plain, policy.policy(CONTEXT)), (sure, policy(CONTEXT))):
            rewards.append(float(np.linalg.norm(TOY.action.normalise(action) - best_action(mean))))
        said.append(policy.predict(CONTEXT))
    assert np.mean(sure) <= np.mean(plain) + 0.01
    assert all(0.0 <= low <= reward <= high <= 1.0 for reward, low, high in said)


def test_only_what_can_be_executed_is_simulated():
    half = TOY.action.denormalise(np.array([0.5, 0.5]))
    policy = confirmed(executable=lambda context, action: bool(action[0] > half[0]))
    assert policy(CONTEXT)[0] > half[0]
    with pytest.raises(NotExecutable, match="limits of the arm"):
        confirmed(executable=lambda context, action: False)(CONTEXT)
