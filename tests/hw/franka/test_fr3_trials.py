"""A push and a scoop, as the sessions plan them, played over the FR3's network protocol."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from campaigns import campaign
from fr3_process import Fr3Process, arm_at

from hw.collision import Tool
from hw.franka.arm import FrankaArm
from hw.kinematics import forward
from hw.types import Array, Execution, JointPath
from sim.panda.planning import home, trial_paths
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

TRACKING_M = 0.03
"""Of the tool: franky-sim's controller lags behind a command by some 20 ms, ten times what a real arm does."""


@cache
def trial(name: str) -> tuple[tuple[JointPath, JointPath, JointPath], Array, Tool]:
    """Approach, task and retreat of the middle action on the FR3; where the tool is in the flange; what it is."""
    task = get_task(name)
    hardware = task.require_hardware()
    cell = cell_as_shipped(hardware, "fr3")
    motion = hardware.plan(task.reference_context, (task.action.low + task.action.high) / 2.0)
    return (
        trial_paths(
            motion, hardware.X_FT, cell, home(hardware.X_FT, cell, hardware.home_pitch_rad), carries=hardware.carries
        ),
        hardware.X_FT,
        cell.tool,
    )


def tool_error_m(played: Execution, X_FT: Array) -> float:
    commanded, measured = ((forward(q) @ X_FT)[:, :3, 3] for q in (played.q_commanded_rad, played.q_measured_rad))
    return float(np.linalg.norm(commanded - measured, axis=1).max())


def play(hurried_fr3: Fr3Process, arm: FrankaArm, path: JointPath, X_FT: Array) -> None:
    played = arm.execute(path)
    n = len(path.t_s)
    np.testing.assert_allclose(played.q_commanded_rad[500:n], path.q_rad[500:], atol=2e-6)
    np.testing.assert_allclose(hurried_fr3.commanded(), played.q_commanded_rad[:-1], atol=1e-12)
    assert played.control_success_rate == 1.0
    assert tool_error_m(played, X_FT) < TRACKING_M
    np.testing.assert_allclose(arm.state().q_rad, path.q_rad[-1], atol=3e-3)


@pytest.mark.parametrize("name", campaign(["scooping", "pushing"], 2))
def test_the_task_path_arrives_sample_by_sample_and_is_followed(hurried_fr3: Fr3Process, name: str) -> None:
    (approach, task, _), X_FT, tool = trial(name)
    hurried_fr3.place(approach.q_rad[0])
    with arm_at(hurried_fr3, tool=tool) as arm:
        arm.execute(approach)  # the arm has to feel its load in two postures before it may touch
        play(hurried_fr3, arm, task, X_FT)
