import numpy as np
import pytest
import torch

from sim.adaptation.q_network import new_network, restore_network
from sim.errors import CheckpointError
from sim.pretraining.q_training import DoubleQLearner, ReplayBuffer, Transitions, branching_target


def steps(n, rng, reward=0.0):
    return Transitions(rng.random((n, 3)), rng.integers(-1, 2, (n, 2)), np.full(n, reward), rng.random((n, 3)))


def test_advantages_are_mean_subtracted_so_that_every_branch_averages_to_the_value():
    network = new_network(3, 2, 0)
    x = torch.rand(5, 3)
    q = network(x)
    assert q.shape == (5, 2, 3)
    value = network.value(network.trunk(x))
    assert torch.allclose(q.mean(dim=-1), value.expand(5, 2), atol=1e-6)


def test_target_takes_the_online_argmax_and_the_target_networks_value():
    online, target = new_network(3, 2, 0), new_network(3, 2, 1)
    following, reward = torch.rand(4, 3), torch.arange(4.0)
    got = branching_target(online, target, reward, following, 0.9)
    with torch.no_grad():
        q_online, q_target = online(following), target(following)
    for i in range(4):
        values = [q_target[i, b, int(q_online[i, b].argmax())] for b in range(2)]
        assert float(got[i]) == pytest.approx(float(reward[i]) + 0.9 * float(sum(values)) / 2, abs=1e-5)
    assert not torch.allclose(got, branching_target(target, target, reward, following, 0.9))


def test_it_learns_which_way_to_go():
    """One parameter x in [0, 1]: reward 1 at the step towards 0.7, 0 otherwise."""
    rng = np.random.default_rng(0)
    learner, replay = DoubleQLearner(new_network(1, 1, 0), 3e-3, 0.5, polyak=0.05), ReplayBuffer(1, 1)
    x = rng.random((2000, 1))
    directions = rng.integers(-1, 2, (2000, 1))
    wanted = np.where(np.abs(x - 0.7) < 0.1, 0, np.sign(0.7 - x)).astype(int)
    following = np.clip(x + 0.15 * directions, 0.0, 1.0)
    replay.add(Transitions(x, directions, (directions == wanted)[:, 0].astype(float), following))
    for _ in range(250):
        learner.update(replay.sample(64, rng))
    test = np.array([[0.1], [0.3], [0.7], [0.95]])
    assert learner.online.directions(test)[:, 0].tolist() == [1, 1, 0, -1]


def test_replay_keeps_the_last_ones():
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(3, 2, capacity=10)
    replay.add(steps(8, rng, reward=1.0))
    replay.add(steps(7, rng, reward=2.0))
    assert len(replay) == 10
    rewards = replay.sample(500, rng)[2]
    assert set(rewards.tolist()) == {1.0, 2.0}
    assert float((rewards == 2.0).float().mean()) == pytest.approx(0.7, abs=0.08)
    choices = replay.sample(500, rng)[1]
    assert int(choices.min()) == 0
    assert int(choices.max()) == 2


def test_updates_repeat_exactly():
    def run():
        rng = np.random.default_rng(5)
        learner, replay = DoubleQLearner(new_network(3, 2, 7), 1e-3, 0.9), ReplayBuffer(3, 2)
        replay.add(steps(100, rng, 1.0))
        return [learner.update(replay.sample(64, rng)) for _ in range(5)]

    assert run() == run()


def test_foreign_weights_are_refused():
    weights = new_network(3, 2, 0).tensors
    same = restore_network(3, 2, weights)
    x = np.random.default_rng(0).random((4, 3))
    assert np.array_equal(same.directions(x), new_network(3, 2, 0).directions(x))
    with pytest.raises(CheckpointError, match=r"does not fit the task: advantage\.2"):
        restore_network(3, 4, weights)
