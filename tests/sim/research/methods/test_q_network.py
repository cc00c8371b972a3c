import numpy as np
import pytest

from sim.errors import CheckpointError
from sim.research.methods.q_network import QNetwork, new_network, restore_network
from sim.research.pretraining.q_training import DoubleQLearner, ReplayBuffer, Transitions, branching_target


def steps(n, rng, reward=0.0):
    return Transitions(rng.random((n, 3)), rng.integers(-1, 2, (n, 2)), np.full(n, reward), rng.random((n, 3)))


def test_advantages_are_mean_subtracted_so_that_every_branch_averages_to_the_value():
    network = new_network(3, 2, 0)
    q, made = network.values(np.random.default_rng(0).random((5, 3)))
    assert q.shape == (5, 2, 3)
    assert np.allclose(q.mean(axis=-1), made.value[-1], atol=1e-6)


@pytest.mark.parametrize("slots", [1, 4])
def test_the_slopes_are_those_of_finite_differences(slots):
    rng = np.random.default_rng(0)
    network = QNetwork(5, 2, slots, new_network(5, 2, 3, slots).flat.astype(np.float64))
    x = rng.random((7, slots, 5))
    x[:, 1:, -1] = rng.integers(0, 2, (7, slots - 1))  # some slots are empty
    weight = rng.standard_normal((7, 2, 3))

    def total():
        return float((network(x.reshape(7, -1)) * weight).sum())

    slopes = network.slopes(network.values(x.reshape(7, -1))[1], weight).copy()
    for i in rng.integers(len(network.flat), size=80):
        before, steps = network.flat[i], []
        for reach in (1e-6, -1e-6):
            network.flat[i] = before + reach
            steps.append(total())
        network.flat[i] = before
        assert slopes[i] == pytest.approx((steps[0] - steps[1]) / 2e-6, abs=1e-7)


def test_target_takes_the_online_argmax_and_the_target_networks_value():
    online, target = new_network(3, 2, 0), new_network(3, 2, 1)
    following, reward = np.random.default_rng(0).random((4, 3)), np.arange(4.0)
    got = branching_target(online, target, reward, following, 0.9)
    q_online, q_target = online(following), target(following)
    for i in range(4):
        values = [q_target[i, b, int(q_online[i, b].argmax())] for b in range(2)]
        assert float(got[i]) == pytest.approx(float(reward[i]) + 0.9 * float(sum(values)) / 2, abs=1e-5)
    assert not np.allclose(got, branching_target(target, target, reward, following, 0.9))


def test_it_learns_which_way_to_go():
    """One parameter x in [0, 1]: reward 1 at the step towards 0.7, 0 otherwise."""
    rng = np.random.default_rng(0)
    learner, replay = DoubleQLearner(new_network(1, 1, 0), 3e-3, 0.5, polyak=0.05), ReplayBuffer(1, 1)
    x = rng.random((2000, 1))
    directions = rng.integers(-1, 2, (2000, 1))
    wanted = np.where(np.abs(x - 0.7) < 0.1, 0, np.sign(0.7 - x)).astype(int)
    following = np.clip(x + 0.15 * directions, 0.0, 1.0)
    replay.add(Transitions(x, directions, (directions == wanted)[:, 0].astype(float), following))
    learner.learn(replay, 250, 64, rng)
    test = np.array([[0.1], [0.3], [0.7], [0.95]])
    assert learner.online.directions(test)[:, 0].tolist() == [1, 1, 0, -1]


def test_replay_keeps_the_last_ones():
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(3, 2, capacity=10)
    replay.add(steps(8, rng, reward=1.0))
    replay.add(steps(7, rng, reward=2.0))
    assert len(replay) == 10
    drawn = replay.sample(500, rng)
    assert set(drawn.reward.tolist()) == {1.0, 2.0}
    assert float((drawn.reward == 2.0).mean()) == pytest.approx(0.7, abs=0.08)
    assert {-1, 0, 1} == set(drawn.directions.ravel().tolist())


def test_updates_repeat_exactly():
    def run():
        rng = np.random.default_rng(5)
        learner, replay = DoubleQLearner(new_network(3, 2, 7), 1e-3, 0.9), ReplayBuffer(3, 2)
        replay.add(steps(100, rng, 1.0))
        return [learner.learn(replay, 1, 64, rng) for _ in range(5)]

    assert run() == run()


def test_foreign_weights_are_refused():
    weights = new_network(3, 2, 0).tensors
    same = restore_network(3, 2, weights)
    x = np.random.default_rng(0).random((4, 3))
    assert np.array_equal(same.directions(x), new_network(3, 2, 0).directions(x))
    with pytest.raises(CheckpointError, match=r"does not fit the task: advantage\.1"):
        restore_network(3, 4, weights)
