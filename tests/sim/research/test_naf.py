import numpy as np
import torch
from toy_learning import roll, train_naf
from toy_task import PARAMETERS, TOY, best_action

from sim.research.naf.policy import NafNetwork

MEAN = PARAMETERS.denormalise(np.array([0.3, 0.5, 1.0, 0.7]))


def test_the_advantage_is_a_full_positive_definite_quadratic_around_the_mean():
    torch.manual_seed(0)
    network = NafNetwork(2, 3)
    context = torch.rand(6, 2)
    value, mean, factor = network(context)
    precision = factor @ factor.transpose(1, 2)
    assert (torch.linalg.eigvalsh(precision) > 0).all()
    assert precision[:, 0, 1].abs().min() > 0
    assert (factor.triu(1) == 0).all()
    assert torch.allclose(network.q(context, mean), value)
    action = torch.rand(6, 3) * 2 - 1
    miss = (action - mean)[:, :, None]
    expected = value - 0.5 * (miss.transpose(1, 2) @ precision @ miss)[:, 0, 0]
    assert torch.allclose(network.q(context, action), expected, atol=1e-5)
    assert mean.abs().max() < 1


def test_it_finds_the_best_action_from_rollouts_alone():
    policy = train_naf(TOY, MEAN[None], roll, 500, 0)
    action = policy(TOY.reference_context)
    assert TOY.action.contains(action)
    assert np.linalg.norm(TOY.action.normalise(action) - best_action(MEAN)) < 0.12


def test_training_goes_on_from_a_donor_and_repeats_exactly():
    donor = train_naf(TOY, MEAN[None], roll, 500, 0)
    near = PARAMETERS.step(MEAN, np.array([1, 0, 0, 0]), 0.1)
    one, two = (train_naf(TOY, near[None], roll, 30, 1, donor) for _ in range(2))
    context = TOY.reference_context
    assert np.array_equal(one(context), two(context))
    scratch = train_naf(TOY, near[None], roll, 30, 1)

    def miss(policy):
        return np.linalg.norm(TOY.action.normalise(policy(context)) - best_action(near))

    assert miss(one) < 0.12
    assert miss(one) < miss(scratch)
    assert not np.array_equal(one(context), donor(context))
