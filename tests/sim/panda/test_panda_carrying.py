"""What lies on the tool comes home on it: the tool moves along a line, turns evenly, and never fast."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from hw.kinematics import forward
from hw.types import JointPath
from perception.types import Outcome
from sim.errors import NotExecutable
from sim.lab.cell import Cell
from sim.lab.world import Faults, Sensing, World
from sim.panda.carrying import GENTLE_M_S2, carry_path
from sim.panda.planning import home, trial_paths
from sim.panda.tool import cell_as_shipped
from sim.tasks.scooping import HARDWARE, TASK

ACTION = np.array([0.10, 0.05, 0.018])  # a gentle late scoop


@cache
def paths(model: str) -> tuple[JointPath, JointPath, JointPath]:
    motion = HARDWARE.plan(TASK.reference_context, ACTION)
    cell = cell_as_shipped(HARDWARE, model)
    return trial_paths(motion, HARDWARE.X_FT, cell, home(HARDWARE.X_FT, cell, HARDWARE.home_pitch_rad), carries=True)


def lean_rad(path: JointPath) -> tuple[np.ndarray, np.ndarray]:
    """Pitch (edge up) and roll of the blade along a path."""
    R = (forward(path.q_rad) @ HARDWARE.X_FT)[:, :3, :3]
    return np.arcsin(R[:, 2, 0]), np.arcsin(R[:, 2, 1])


@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_the_way_home_keeps_the_blade_tilted_back_and_level_across(model: str) -> None:
    _, task, back = paths(model)
    pitch, roll = lean_rad(back)
    ends = lean_rad(task)[0][-1], -HARDWARE.home_pitch_rad
    assert pitch.min() > min(ends) - 0.002
    assert pitch.max() < max(ends) + 0.002
    assert np.abs(roll).max() < 0.002
    np.testing.assert_allclose(back.q_rad[0], task.q_rad[-1], atol=1e-9)
    assert cell_as_shipped(HARDWARE, model).check(back).ok


def test_the_tool_travels_straight_and_never_speeds_up_by_more_than_a_round_piece_bears() -> None:
    back = paths("panda")[2]
    p_m = (forward(back.q_rad) @ HARDWARE.X_FT)[:, :3, 3]
    speeding = np.linalg.norm(np.diff(p_m[:, :2], 2, axis=0), axis=1) * 1e6
    assert speeding.max() < 1.1 * GENTLE_M_S2
    far = p_m[np.linalg.norm(p_m[:, :2] - p_m[0, :2], axis=1) > 1e-6]
    ahead = (far[-1] - far[0]) / np.linalg.norm(far[-1] - far[0])
    beside = (far - far[0]) - np.outer((far - far[0]) @ ahead, ahead)
    assert np.linalg.norm(beside, axis=1).max() < 5e-4


def test_an_arm_that_would_have_to_fold_otherwise_is_refused() -> None:
    q_to = paths("panda")[2].q_rad[-1]
    flipped = q_to + np.array([np.pi if q_to[0] < 0 else -np.pi, 0, np.pi if q_to[2] < 0 else -np.pi, 0, 0, 0, 0])
    flipped[1] = -q_to[1]
    far = np.array([flipped[0], flipped[1], flipped[2], -2.0, 0.5, 2.9, -0.5])
    with pytest.raises(NotExecutable):
        carry_path(far, q_to, HARDWARE.X_FT, cell_as_shipped(HARDWARE, "panda").arm)


@pytest.mark.long
def test_an_olive_that_was_scooped_is_still_on_the_blade_at_home() -> None:
    """Round, and at the root of the blade when the motion ends."""
    parameters, nuisance = np.array([0.326, 2.2e5, 0, 2.08]), np.array([0.011])
    action = np.array([-0.0043, 0.0508, 0.0055])
    expected = TASK.simulate(parameters, TASK.reference_context, action, nuisance)
    assert expected.outcome is Outcome.ON_BLADE
    cell = Cell(TASK, World("olive", TASK.name, "", parameters, nuisance, TASK.unmodelled(), Sensing(), Faults()))
    shipped = cell_as_shipped(HARDWARE, "panda")
    q_home = home(HARDWARE.X_FT, shipped, HARDWARE.home_pitch_rad)
    motion = HARDWARE.plan(TASK.reference_context, action)
    _, path, back = trial_paths(motion, HARDWARE.X_FT, shipped, q_home, carries=True)
    cell.reset(path.q_rad[0], HARDWARE.rest_pose(TASK.reference_context, parameters, nuisance, None))
    for way in (path, back):
        cell.simulate(way.t_s, way.q_rad)
        poses = cell.poses(cell.positions[None])
        x_m, y_m, z_m = (np.linalg.inv(poses[cell.bodies.tool][0]) @ poses[cell.bodies.object][0])[:3, 3]
        assert -0.10 < x_m < 0.0
        assert abs(y_m) < 0.03
        assert 0.005 < z_m < 0.02
