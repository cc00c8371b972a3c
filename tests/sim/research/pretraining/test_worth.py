"""A pretraining says what it is worth, in the unit of the reward."""

from __future__ import annotations

import numpy as np
import pytest
from moving_task import TASK as ROLLING
from toy_learning import dataset, reward_table, trained

from sim.adaptation.reward_table import RewardTableSettings, tabulate_rewards
from sim.adaptation.worth_in_words import worth_in_words
from sim.research.pretraining.worth import measured_worth
from sim.solvers.emulator.training import reward_error
from sim.solvers.grid import grid_solver


def test_the_error_of_the_reward_is_that_of_the_emulator():
    emulator, _ = trained()
    requests, true = dataset().select(np.arange(300, dtype=np.intp))
    assert 0.0 < reward_error(emulator, requests, true) < 0.12
    shuffled = requests[np.random.default_rng(0).permutation(300)]
    assert reward_error(emulator, shuffled, true) > 2.0 * reward_error(emulator, requests, true)


@pytest.mark.slow
def test_it_names_parameters_that_no_trial_tells_and_actions_at_their_ends():
    worth = measured_worth(trained()[0], reward_table(), 0.04, 0)
    assert worth.hopeless_parameters < 0.2
    assert set(worth.actions_at_end) == set(trained()[0].task.action.names)
    grid = grid_solver(ROLLING)
    rolling = measured_worth(grid, tabulate_rewards(grid, 0, RewardTableSettings(16, 64, 4)), None, 0)
    assert rolling.reward_error is None
    assert rolling.unknown_parameters == ()
    assert rolling.hopeless_contexts < 0.1


def test_the_sentences_name_shares_and_remedies():
    assert worth_in_words(None) == []
    sentences = worth_in_words(
        {
            "reward_error": 0.2,
            "hopeless_parameters": 0.3,
            "hopeless_contexts": 0.5,
            "unknown_parameters": ("mass", "rail"),
            "actions_at_end": {"push": 0.4, "yaw": 0.1},
        }
    )
    assert sentences == [
        "The emulator errs by 0.20 of the reward on rollouts that it has not seen: simulate more, or choose a smoother "
        "reward.",
        "In 30% of the parameters' ranges no action is expected to earn half of the reward.",
        "In 50% of all contexts no action is expected to earn half of the reward.",
        "Trials hardly tell the value of mass, rail: other parameters explain the same trials.",
        "40% of the best actions lie at an end of the range of push: widen it.",
    ]
