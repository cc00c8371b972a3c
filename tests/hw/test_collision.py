from collections.abc import Callable

import numpy as np
import pytest
from cells import READY, cell, stick
from fingertip_paths import Q_TOP_RAD, TOOL
from scipy.optimize import minimize

from hw.capsules import box_distance, segment_distance
from hw.collision import (
    BARE_HAND,
    HAND_MASS,
    LEVEL,
    KeepOut,
    Side,
    Table,
    Tool,
    box_clearance,
    camera_box,
    persons_side,
    point_heights,
    self_clearance,
    table_clearance,
)
from hw.kinematics import link_poses
from hw.outline import FINGERS, HAND
from hw.types import JointPath
from hw.wrist import FINGERTIP_M


def brute_force(distance_at: Callable[[np.ndarray], float], bounds: list[tuple[float, float]]) -> float:
    starts = [[b * (0.1 + 0.8 * s) for _, b in bounds] for s in (0.0, 0.5, 1.0)]
    return min(float(minimize(distance_at, s, bounds=bounds, options={"ftol": 1e-15}).fun) for s in starts) ** 0.5


def test_segment_distance_agrees_with_a_numerical_minimum() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 40, 2, 3))
    found = segment_distance(a, b)
    for i in range(len(a)):

        def squared(u: np.ndarray, i: int = i) -> float:
            gap = a[i, 0] + u[0] * (a[i, 1] - a[i, 0]) - b[i, 0] - u[1] * (b[i, 1] - b[i, 0])
            return float(gap @ gap)

        assert found[i] == pytest.approx(brute_force(squared, [(0, 1), (0, 1)]), abs=1e-5)


def test_segment_distance_of_parallel_and_pointlike_segments() -> None:
    along = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert segment_distance(along, along + np.array([3.0, 4.0, 0.0])) == pytest.approx(np.hypot(2.0, 4.0))
    assert segment_distance(along, along[::-1] + np.array([0.0, 2.0, 0.0])) == pytest.approx(2.0)
    point = np.array([[0.5, 1.0, 0.0], [0.5, 1.0, 0.0]])
    assert segment_distance(along, point) == pytest.approx(1.0)
    assert segment_distance(point, point + np.array([0.0, 0.0, 2.0])) == pytest.approx(2.0)


def test_box_distance_agrees_with_a_dense_scan() -> None:
    rng = np.random.default_rng(1)
    segments = rng.normal(size=(60, 2, 3))
    low, high = np.array([-0.3, -0.5, -0.1]), np.array([0.4, 0.2, 0.6])
    share = np.linspace(0.0, 1.0, 20001)[:, None]
    for segment, found in zip(segments, box_distance(segments, low, high), strict=True):
        points = segment[0] + share * (segment[1] - segment[0])
        scanned = np.linalg.norm(points - np.clip(points, low, high), axis=1).min()
        assert found == pytest.approx(scanned, abs=1e-4)


def test_ready_posture_is_clear_and_a_folded_arm_is_not() -> None:
    clearance, names = self_clearance(link_poses(READY), BARE_HAND)
    assert clearance.min() > 0.1
    folded = READY + np.array([0.0, 0.0, 0.0, -0.7, 0.0, -1.6, -np.pi / 4])
    clearance, names = self_clearance(link_poses(folded), BARE_HAND)
    assert clearance.min() < 0.0
    assert names[int(np.argmin(clearance))] == "link 2 and guide button"


def test_box_and_table_clearances_name_the_body() -> None:
    box = KeepOut("camera", np.array([0.25, -0.1, 0.3]), np.array([0.4, 0.1, 0.5]))
    clearance, names = box_clearance(link_poses(READY), BARE_HAND, box)
    assert clearance.min() < 0.0
    assert names[int(np.argmin(clearance))] in ("hand and camera", "fingers and camera")
    heights, names = table_clearance(link_poses(READY), BARE_HAND, LEVEL)
    assert names[int(np.argmin(heights))] == "link 2 and table"
    fingers_m = min(height for height, name in zip(heights, names, strict=True) if name == "fingers and table")
    assert 0.5903 - FINGERTIP_M - 0.007 < fingers_m < 0.5903 - FINGERTIP_M


def test_heights_of_tool_points() -> None:
    tool = stick([[0.0, 0.0, 0.2], [0.1, 0.0, 0.0]])
    assert np.allclose(point_heights(link_poses(READY), tool, LEVEL), [0.3903, 0.5903], atol=1e-4)


STILL = JointPath(np.array([0.0, 1e-3]), np.stack([Q_TOP_RAD, Q_TOP_RAD]))


def test_the_tables_frame_lies_in_its_plane() -> None:
    table = Table(-0.012, 0.02, -0.03)
    p_W = np.array([[0.6, 0.1, 0.0], [0.3, -0.4, 0.0], [0.0, 0.0, 0.0]])
    p_B = p_W @ table.X_BW[:3, :3].T + table.X_BW[:3, 3]
    np.testing.assert_allclose(p_B[:, 2], table.height_at(p_B), atol=1e-12)
    np.testing.assert_allclose(table.X_BW[:3, :3] @ table.X_BW[:3, :3].T, np.eye(3), atol=1e-12)
    assert table.X_BW[1, 0] == 0.0  # X stays in the plane of the base's X and Z
    np.testing.assert_array_equal(LEVEL.X_BW, np.eye(4))


def test_heights_count_from_the_table() -> None:
    poses = link_poses(Q_TOP_RAD[None])
    level = point_heights(poses, TOOL, LEVEL)[0, 0]
    assert level == pytest.approx(0.02, abs=1e-6)
    assert point_heights(poses, TOOL, Table(-0.01))[0, 0] == pytest.approx(0.03, abs=1e-6)
    assert point_heights(poses, TOOL, Table(0.0, 0.02))[0, 0] == pytest.approx(0.02 - 0.02 * 0.5, abs=1e-5)


def test_a_path_is_checked_against_the_table_where_it_is() -> None:
    assert cell(tool=TOOL).check(STILL).ok
    high = cell(tool=TOOL).over(Table(0.03)).check(STILL)
    assert not high.ok
    assert high.worst.quantity == "depth in the table"


def test_the_tip_of_a_tool_stays_out_of_boxes_too() -> None:
    long = Tool("long", HAND_MASS, (*HAND, *FINGERS), np.array([[0.0, 0.0, 0.30]]))
    poses = link_poses(Q_TOP_RAD[None])
    tip = (poses[0, 8] @ [0.0, 0.0, 0.30, 1.0])[:3]
    box = KeepOut("box", tip - 0.01, tip + 0.01)
    clearance, names = box_clearance(poses, long, box)
    assert names[int(np.argmin(clearance[0]))] == "tip of long and box"
    assert clearance.min() == 0.0


def test_boxes_of_camera_and_person() -> None:
    X_BC = np.eye(4)
    X_BC[:3, 3] = [1.3, 0.0, 0.7]
    box = camera_box(X_BC)
    np.testing.assert_allclose((box.low_m + box.high_m) / 2.0, X_BC[:3, 3])
    sides: tuple[tuple[Side, int, int], ...] = (("left", 1, 1), ("right", 1, -1), ("front", 0, 1), ("back", 0, -1))
    for side, axis, sign in sides:
        side_box = persons_side(side, 0.5)
        inside = np.zeros(3)
        inside[axis] = sign * 0.6
        assert ((inside > side_box.low_m) & (inside < side_box.high_m)).all(), side
        inside[axis] = sign * 0.4
        assert not ((inside > side_box.low_m) & (inside < side_box.high_m)).all(), side
    with pytest.raises(ValueError, match="one of left, right"):
        persons_side("above", 0.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"begins 0\.1 m"):
        persons_side("left", 0.1)
