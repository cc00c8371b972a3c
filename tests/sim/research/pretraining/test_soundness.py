"""A task of another package is checked by its first rollouts."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from moving_task import TASK as ROLLING
from toy_task import TOY

from sim.errors import RolloutError
from sim.rollouts.soundness import require_sound
from sim.tasks.pendulum import TASK

RNG = np.random.default_rng


def one_by_one(**changes):
    return replace(TASK, simulate_many=None, **changes)


def test_our_own_task_is_sound():
    require_sound(TASK, RNG(0))


def test_rewards_that_are_no_numbers_are_said_before_any_training():
    with pytest.raises(RolloutError, match=r"gives the reward nan .* numbers from 0 to 1"):
        require_sound(one_by_one(reward_of_success=lambda end, context: np.full(np.shape(end)[:-1], np.nan)), RNG(0))


def test_a_task_that_is_not_deterministic_is_said():
    calls = count(1)

    def simulate(*values):
        track = TASK.simulate(*values)
        return replace(track, state=track.state * (1 + 1e-3 * next(calls)))

    with pytest.raises(RolloutError, match="is not deterministic: the same rollout differs by up to"):
        require_sound(one_by_one(simulate=simulate), RNG(0))


def test_an_exception_in_simulate_is_said_with_the_action():
    def simulate(*values):
        raise KeyError("no friction")

    with pytest.raises(RolloutError, match=r"pendulum cannot simulate parameters .*KeyError: 'no friction'"):
        require_sound(one_by_one(simulate=simulate), RNG(0))
    with pytest.raises(RolloutError, match="returns int, not an ObjectTrack"):
        require_sound(one_by_one(simulate=lambda *values: 3), RNG(0))


def test_a_relocate_that_is_false_is_refused_and_one_that_is_left_out_is_not():
    """A context that changes the motion, with the identity as `relocate`: a usual mistake."""
    with pytest.raises(RolloutError, match="relocate"):
        require_sound(replace(ROLLING, relocate=lambda observation, context: observation), RNG(0))
    require_sound(ROLLING, RNG(0))


def test_a_relocate_that_is_true_is_accepted():
    require_sound(TOY, RNG(0))
