"""Among actions that look equal, the one whose surroundings are good as well is chosen."""

import numpy as np

from sim.rollouts.draws import sobol
from sim.solvers.interior import ALIKE, prefer_interior

EVEN = sobol(256, 2, np.random.default_rng(0))


def chosen(worth):
    return EVEN[np.argmax(prefer_interior(EVEN, worth, EVEN, worth))]


def test_on_a_plateau_the_middle_is_chosen_and_not_an_end():
    plateau = np.full(len(EVEN), 0.9)
    assert np.abs(chosen(plateau) - 0.5).max() < 0.2
    assert np.abs(chosen(plateau + 0.5 * ALIKE * EVEN[:, 0]) - 0.5).max() < 0.2


def test_a_better_action_at_an_end_is_chosen():
    assert chosen(EVEN[:, 0])[0] > 1.0 - 2.0 * ALIKE


def test_a_cliff_is_kept_away_from():
    beyond = np.where(EVEN[:, 0] > 0.4, 0.9, 0.0)
    assert chosen(beyond)[0] > 0.5
