"""Free motions go around boxes, or say what is in the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hw.collision import KeepOut, Table, camera_box, persons_side
from hw.joint_limits import LIMITS
from hw.types import Array, JointPath
from hw.workcell import Workcell
from sim.errors import NotExecutable
from sim.panda.moves import free_path, move_path
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()
FREE = cell_as_shipped(HARDWARE, "panda")
LOW = np.array([-1.2, -1.0, -0.6, -2.7, -0.8, 1.0, -1.5])
HIGH = np.array([1.2, 0.9, 0.6, -0.8, 0.8, 3.0, 2.0])


def among(boxes: tuple[KeepOut, ...]) -> Workcell:
    return replace(FREE, keep_out=boxes)


def clear(q_rad: Array, boxes: tuple[KeepOut, ...]) -> bool:
    still = JointPath(np.array([0.0, 1e-3]), np.stack([q_rad, q_rad]))
    return among(boxes).check(still).ok


def scene(rng: np.random.Generator) -> tuple[KeepOut, ...]:
    X_BC = np.eye(4)
    X_BC[:3, 3] = [1.28, 0.0, 0.72]
    middle = rng.uniform([0.35, -0.3, 0.2], [0.65, 0.3, 0.6])
    half = rng.uniform(0.05, 0.12, 3)
    return camera_box(X_BC), persons_side("right", 0.55), KeepOut("box", middle - half, middle + half)


def blocked(rng: np.random.Generator) -> tuple[Array, Array, tuple[KeepOut, ...]]:
    """Two clear postures with something between them."""
    while True:
        boxes = scene(rng)
        ends = [q for q in rng.uniform(LOW, HIGH, (12, 7)) if clear(q, boxes)][:2]
        if len(ends) == 2 and not among(boxes).check(move_path(ends[0], ends[1], LIMITS["panda"], 0.25)).ok:
            return ends[0], ends[1], boxes


def around(seeds: range) -> int:
    found = 0
    for seed in seeds:
        q_from, q_to, boxes = blocked(np.random.default_rng(seed))
        try:
            path = free_path(q_from, q_to, among(boxes))
        except NotExecutable as error:
            assert "no way around" in str(error)
            continue
        assert among(boxes).check(path, q_from).ok
        np.testing.assert_allclose(path.q_rad[-1], q_to)
        found += 1
    return found


@pytest.mark.long
def test_random_blocked_motions_go_around() -> None:
    assert around(range(2)) == 2


@pytest.mark.slow
def test_nearly_all_random_blocked_motions_go_around() -> None:
    assert around(range(40)) >= 36


def test_a_free_way_is_straight() -> None:
    q_from, q_to = (LOW + HIGH) / 2.0, (LOW + HIGH) / 2.0 + 0.2
    path, direct = free_path(q_from, q_to, FREE), move_path(q_from, q_to, LIMITS["panda"], 0.25)
    np.testing.assert_array_equal(path.q_rad, direct.q_rad)


def test_what_stands_where_the_arm_shall_go_is_named() -> None:
    q_from, q_to = (LOW + HIGH) / 2.0, (LOW + HIGH) / 2.0 + 0.2
    wall = KeepOut("wall", np.array([0.3, -1.0, 0.0]), np.array([2.0, 1.0, 2.0]))
    with pytest.raises(NotExecutable, match=r"not clear at the start of its way: keep-out of .* and wall"):
        free_path(q_from, q_to, among((wall,)))
    with pytest.raises(NotExecutable, match="not clear"):
        free_path(q_from, q_to, FREE.over(Table(0.5)))
