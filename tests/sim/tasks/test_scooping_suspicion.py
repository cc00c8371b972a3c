"""An edge that is too high: what the first scoops then have in common, and what they have not by chance."""

from __future__ import annotations

import numpy as np
import pytest

from perception.types import ObjectTrack, Outcome
from sim.lab.world import load_world
from sim.tasks import get_task
from sim.tasks.scooping import rollout
from sim.tasks.scooping.plan import plan
from sim.tasks.scooping.suspicion import FIRST, PUSHED_M, edge_too_high
from sim.types import ToolMotion

TASK = get_task("scooping")


def scooped(higher_m: float, seed: int) -> ObjectTrack:
    """A scoop of a slice of cucumber with the edge so much too high."""
    world, rng = load_world("cucumber", TASK), np.random.default_rng(seed)
    context, action = TASK.context.sample(rng, 1)[0], TASK.action.sample(rng, 1)[0]
    level = plan(context, action)
    X_BT = level.X_BT.copy()
    X_BT[:, 2, 3] += higher_m
    X_BO = rollout.rest_pose(context, world.parameters, world.nuisance, world.unmodelled)
    raised = ToolMotion(level.t_s, X_BT, level.contact)
    return rollout.track_of(rollout.readings(raised, X_BO, world.parameters, world.nuisance, world.unmodelled), level)


def track(outcome: Outcome, ahead_m: float) -> ObjectTrack:
    state = np.array([[0.66, 0.0, 0.01], [0.66 + ahead_m, 0.0, 0.01]])
    return ObjectTrack(np.array([0.0, 1.0]), state, outcome, np.array([0.1, 0.0, -0.03]), np.ones(2))


PUSHED, SCOOPED = track(Outcome.ON_TABLE, 0.2), track(Outcome.ON_BLADE, 0.2)


@pytest.mark.long
def test_an_edge_2_mm_too_high_over_cucumber_is_suspected() -> None:
    suspicion = edge_too_high([scooped(0.002, seed) for seed in range(FIRST)])
    assert suspicion is not None
    assert suspicion.question == "Is the edge too high?"
    assert "strip of paper" in suspicion.look
    assert edge_too_high([scooped(0.0, seed) for seed in range(FIRST)]) is None


def test_it_takes_four_alike_and_ends_with_the_first_success() -> None:
    assert edge_too_high([PUSHED] * (FIRST - 1)) is None
    assert edge_too_high([PUSHED] * FIRST) is not None
    assert edge_too_high([PUSHED] * 12) is not None
    assert edge_too_high([*[PUSHED] * FIRST, SCOOPED]) is None
    assert edge_too_high([*[PUSHED] * 3, SCOOPED]) is None


@pytest.mark.parametrize("other", [track(Outcome.ON_TABLE, 0.9 * PUSHED_M), track(Outcome.LOST, 0.2)])
def test_a_piece_that_ended_otherwise_says_nothing_of_the_edge(other: ObjectTrack) -> None:
    assert edge_too_high([PUSHED, PUSHED, other, PUSHED]) is None


def test_a_task_without_a_suspicion_has_none() -> None:
    assert get_task("pushing").require_hardware().suspect([PUSHED] * FIRST) is None
