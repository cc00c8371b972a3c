"""Rollouts in a world are those of its task with everything but context and action taken from the world."""

from __future__ import annotations

import pickle

import numpy as np

from sim.lab.world import load_world, rollouts_in
from sim.tasks import get_task

TASK = get_task("pendulum")
WORLD = load_world("ood-1", TASK)
ACTION = TASK.action.denormalise(np.full(len(TASK.action), 0.4))


def test_the_world_gives_everything_but_context_and_action() -> None:
    asked = TASK.parameters.middle
    found = rollouts_in(WORLD)(asked, TASK.reference_context, ACTION, WORLD.nuisance)
    there = TASK.simulate(WORLD.parameters, TASK.reference_context, ACTION, WORLD.nuisance, WORLD.unmodelled)
    elsewhere = TASK.simulate(asked, TASK.reference_context, ACTION, WORLD.nuisance)
    assert np.array_equal(found.state, there.state)
    assert not np.array_equal(found.state, elsewhere.state)


def test_they_travel_to_another_process() -> None:
    there = pickle.loads(pickle.dumps(rollouts_in(WORLD)))  # noqa: S301 - what was pickled here
    found = there(WORLD.parameters, TASK.reference_context, ACTION, WORLD.nuisance)
    assert found.outcome is rollouts_in(WORLD)(WORLD.parameters, TASK.reference_context, ACTION, WORLD.nuisance).outcome
