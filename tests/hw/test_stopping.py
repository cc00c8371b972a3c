"""The one worst case of a stop: its parts, and that no stop of the player's own tables goes farther or takes longer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cells import READY, cell, joint, move
from hard_paths import LOADED

from hw.braking import BEFORE_S, FULL, LAG_S, LONGEST_S, STOP_S, WORST_STOP_S, at_pace
from hw.capsules import segments
from hw.collision import moving
from hw.franka.playback import motion_of
from hw.kinematics import link_poses
from hw.stopping import REDUCED_M_S, reduced_pace, speeds_m_s, worst_stop
from hw.types import Array, JointPath
from hw.watchdog import SILENCE_S

CELL = cell("fr3", LOADED)
PATH = move(joint(1, 0.9) + joint(4, 0.2), 1.1)


def points_m(path: JointPath) -> Array:
    """(N, P, 3) both ends of every capsule that moves, and the tip."""
    poses = link_poses(path.q_rad)
    return segments(poses, moving(LOADED)).reshape(len(poses), -1, 3)


def test_the_time_is_the_sum_of_its_parts_and_stays_the_same_for_every_motion() -> None:
    bound = worst_stop(CELL)
    assert bound.time_s == WORST_STOP_S == pytest.approx(SILENCE_S + 0.006 + STOP_S)
    assert bound.braking_s == LONGEST_S
    own = worst_stop(CELL, (PATH,))
    assert own.time_s == pytest.approx(BEFORE_S + own.braking_s + LAG_S)
    assert own.time_s < bound.time_s
    assert own.distance_m < bound.distance_m
    assert str(own) == f"at most {own.time_s:.2f} s and {100 * own.distance_m:.0f} cm"


def test_no_stop_of_the_player_goes_farther() -> None:
    own, way_m = worst_stop(CELL, (PATH,)), points_m(PATH)
    step_m = np.concatenate([np.zeros((1, way_m.shape[1])), np.linalg.norm(np.diff(way_m, axis=0), axis=2)])
    travel_m = np.cumsum(step_m, axis=0)
    motion, farthest_m = motion_of(PATH, CELL.motion), 0.0
    for at, duration_s, slowed_s in zip(motion.stop_at, motion.stop_s, motion.slowed_s, strict=True):
        wished = max(int(at) - round(1e3 * (BEFORE_S + LAG_S)), 0)
        ends = min(round(1e3 * slowed_s[-1]), len(travel_m) - 1)
        farthest_m = max(farthest_m, float((travel_m[ends] - travel_m[wished]).max()))
        assert BEFORE_S + duration_s + LAG_S <= own.time_s + 0.011
    assert 0.05 < farthest_m <= own.distance_m + 1e-3
    assert own.distance_m < 1.5 * farthest_m, "and not twice as far either: the number is of use"


def test_a_slower_pace_stops_sooner_and_a_longer_tool_goes_farther() -> None:
    fast, slow = worst_stop(CELL, (PATH,)), worst_stop(CELL, (PATH,), 0.3)
    assert slow.distance_m < 0.4 * fast.distance_m
    assert slow.speed_m_s == pytest.approx(0.3 * fast.speed_m_s, rel=1e-2)
    longer = replace(LOADED, points_F_m=np.array([[0.3, 0.0, 0.3]]))
    assert worst_stop(cell("fr3", longer), (PATH,)).distance_m > fast.distance_m
    assert worst_stop(cell("fr3", longer)).distance_m > worst_stop(CELL).distance_m
    assert worst_stop(CELL, (), 0.5).distance_m == pytest.approx(0.5 * worst_stop(CELL).distance_m)
    assert worst_stop(cell("panda", LOADED)).speed_m_s < worst_stop(CELL).speed_m_s


def test_no_point_of_a_body_is_faster_than_its_bound() -> None:
    rng = np.random.default_rng(3)
    bound = speeds_m_s(PATH, CELL)
    poses = link_poses(PATH.q_rad)
    for i, body in enumerate(moving(LOADED)):
        share, off = rng.uniform(size=(200, 1)), rng.standard_normal((200, 3))
        off *= body.radius_m / np.linalg.norm(off, axis=1)[:, None]
        inside = body.start_m + share * (body.end_m - body.start_m) + off
        at_m = np.einsum("nij,pj->npi", poses[:, body.link, :3, :3], inside) + poses[:, None, body.link, :3, 3]
        speed = np.linalg.norm(np.diff(at_m, axis=0), axis=2) * 1e3
        assert (speed <= bound[:, i, None] + 1e-6).all(), body.name
        assert speed.max() > 0.7 * bound[:, i].max()


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_a_reduced_pace_keeps_every_point_under_250_mm_s(model: str) -> None:
    here, stretched = cell(model, LOADED), READY + joint(2, 1.2) + joint(4, 1.0)
    path = move(joint(1, 0.9), 1.1, start_rad=stretched)
    pace = reduced_pace(path, here, 0.6)
    slow = at_pace(path, pace)
    assert pace < 0.3, "a ratio of 0.3 would be too fast here"
    assert 0.95 * REDUCED_M_S < speeds_m_s(slow, here).max() < REDUCED_M_S
    assert np.linalg.norm(np.diff(points_m(slow), axis=0), axis=2).max() * 1e3 < REDUCED_M_S
    here.require(slow, slow.q_rad[0])


def test_a_motion_that_is_slow_already_keeps_its_pace() -> None:
    assert reduced_pace(move(joint(7, 0.1), 4.0), CELL, 0.3) == 0.3
    still = JointPath(np.arange(500) / 1e3, np.repeat(READY[None], 500, axis=0))
    assert reduced_pace(still, CELL) == FULL
