"""Where the table top is, and the boxes that the arm keeps out of."""

from __future__ import annotations

import numpy as np
import pytest
from cells import cell
from guarded_paths import Q_TOP_RAD, TOOL

from hw.collision import (
    HAND,
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
)
from hw.kinematics import link_poses
from hw.types import JointPath

STILL = JointPath(np.array([0.0, 1e-3]), np.stack([Q_TOP_RAD, Q_TOP_RAD]))


def test_the_tables_frame_lies_in_its_plane() -> None:
    table = Table(-0.012, 0.02, -0.03)
    p_W = np.array([[0.6, 0.1, 0.0], [0.3, -0.4, 0.0], [0.0, 0.0, 0.0]])
    p_B = p_W @ table.X_BW[:3, :3].T + table.X_BW[:3, 3]
    np.testing.assert_allclose(p_B[:, 2], table.height_at(p_B), atol=1e-12)
    np.testing.assert_allclose(table.X_BW[:3, :3] @ table.X_BW[:3, :3].T, np.eye(3), atol=1e-12)
    assert table.X_BW[1, 0] == 0.0  # X stays in the plane of the base's X and Z
    np.testing.assert_array_equal(LEVEL.X_BW, np.eye(4))
    with pytest.raises(ValueError, match="slope"):
        Table(0.0, 0.2)


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
    long = Tool("long", HAND_MASS, HAND, np.array([[0.0, 0.0, 0.30]]))
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
