"""AdaptSim by inference: trajectories weigh the truths, rewards correct what no parameters express."""

import numpy as np
import pytest
from toy_learning import TARGET, reward_table, trained, trial, tried
from toy_task import ACTION, PARAMETERS, TOY, Unmodelled, best_action

from sim.adaptation.checkpoint import load_checkpoint, save_checkpoint
from sim.adaptation.methods import make_method
from sim.adaptation.methods.belief import AdaptSimBelief
from sim.adaptation.reward_table import APART, restore_reward_table
from sim.errors import CheckpointError


def belief():
    return AdaptSimBelief(trained()[0], reward_table())


def test_the_reward_table_is_what_policies_earn_and_come_back_from_tensors():
    found = reward_table()
    assert found.rewards.shape == (64, 512)
    assert all(PARAMETERS.contains(c) for c in found.candidates)
    assert all(TOY.margin.contains(t) for t in found.truths)
    distance = np.linalg.norm(
        PARAMETERS.normalise(found.candidates)[:, None, [0, 3]] - PARAMETERS.normalise(found.truths)[None, :, [0, 3]],
        axis=-1,
    )
    assert found.rewards[distance < 0.1].mean() > found.rewards[distance > 0.8].mean() + 0.3
    again = restore_reward_table(TOY, found.tensors)
    assert np.array_equal(again.rewards, found.rewards)
    assert np.array_equal(again.truths, found.truths)
    with pytest.raises(CheckpointError, match="holds no 'truths'"):
        restore_reward_table(TOY, {"candidates": found.tensors["candidates"]})


def test_trajectories_find_what_they_show_of_the_truth():
    action = ACTION.denormalise(np.array([0.5, 0.5]))
    method = belief()
    weights = method.weights([tried(TARGET, *(trial(action, seed=s) for s in range(4)))])
    assert weights.sum() == pytest.approx(1.0)
    mu = PARAMETERS.normalise(reward_table().truths)[:, 0]
    assert weights @ mu == pytest.approx(0.85, abs=0.1)
    assert np.sqrt(weights @ (mu - weights @ mu) ** 2) < 0.5 * mu.std()


def test_a_session_comes_close_to_the_best_policy_at_once():
    method, action = belief(), ACTION.denormalise(np.array([0.5, 0.5]))
    history = [tried(TARGET, *(trial(action, seed=s) for s in range(2)))]
    first, second = (p.mean for p in (*method.next(history, np.random.default_rng(0)), *method.start(1, None)))
    policy = trained()[0].policies(np.array([first, second])[:, None], np.random.default_rng(0))
    miss = [np.linalg.norm(ACTION.normalise(p.actions(np.zeros((1, 2)))[0]) - best_action(TARGET)) for p in policy]
    assert miss[0] < 0.2
    assert miss[0] < 0.6 * miss[1]


def test_rewards_decide_where_no_parameters_explain_them():
    """Trajectories say that one E is right; its trials fail all the same, and those of another succeed."""
    method, action = belief(), ACTION.denormalise(np.array([0.5, 0.5]))
    trials = [trial(action, seed=s) for s in range(2)]
    promised = method.next([tried(TARGET, *trials)], np.random.default_rng(0))[0].mean
    elsewhere = reward_table().candidates[
        np.argmax(np.linalg.norm(PARAMETERS.normalise(reward_table().candidates - promised), axis=1))
    ]
    history = []
    for _ in range(4):
        for mean, reward in ((promised, 0.0), (elsewhere, 1.0)):
            history.append(tried(mean, *(trial(action, reward=reward, seed=s) for s in range(2))))
    found = method.next(history, np.random.default_rng(0))[0].mean
    gap = {name: np.linalg.norm(PARAMETERS.normalise(found) - PARAMETERS.normalise(m)) for name, m in
           (("promised", promised), ("elsewhere", elsewhere))}  # fmt: skip
    assert gap["elsewhere"] < gap["promised"]


def test_what_no_parameters_express_leaves_many_truths_possible():
    action = ACTION.denormalise(np.array([0.5, 0.5]))
    odd = [trial(action, Unmodelled(wind_m=0.06), seed=s) for s in range(2)]
    weights = belief().weights([tried(TARGET, *odd)])
    assert 1.0 / (weights**2).sum() > 5.0  # effective number
    assert np.isfinite(weights).all()


def test_particles_are_candidates_that_lie_apart_and_nothing_is_random():
    method, action = belief(), ACTION.denormalise(np.array([0.2, 0.8]))
    history = [tried(TARGET, trial(action))]
    one = [p.mean.tolist() for p in method.start(3, np.random.default_rng(0))]
    assert one == [p.mean.tolist() for p in belief().start(3, np.random.default_rng(1))]
    assert all(c in reward_table().candidates.tolist() for c in one)
    unit = PARAMETERS.normalise(np.array(one))
    assert (np.linalg.norm(unit[:, None] - unit[None], axis=-1) + np.eye(3)).min() >= APART
    after = method.next([*history, *history], np.random.default_rng(0))
    assert len(after) == 1
    assert (method.estimate(history)[1] < method.estimate([])[1]).mean() > 0.9


def test_a_checkpoint_without_a_reward_table_says_so(tmp_path):
    emulator, _ = trained()
    without = load_checkpoint(TOY, str(save_checkpoint(TOY, tmp_path / "b", emulator, {}, {})))
    with pytest.raises(CheckpointError, match=r"holds no reward table: make .* with `adaptsim pretrain --task toy`"):
        make_method("adaptsim-belief", TOY, without)
