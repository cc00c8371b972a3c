"""What was planned for an arm with joint zeros is not refused by that arm afterwards."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from players import InstantArm

from adaptsim_cli.bench.devices.mounted import MountedTask, mounted_task_of
from adaptsim_cli.bench.rig import Paths
from adaptsim_cli.bench.rig_file.description import as_shipped
from hw.errors import MotionRefused
from hw.kinematics import forward
from hw.workcell import Workcell, arm_model
from sim.errors import NotExecutable
from sim.tasks import get_task
from sim.types import ToolMotion

pytestmark = pytest.mark.long

TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()
ZEROS_RAD = 3e-3
SCOOPS = 6


@cache
def planned(scoops: int, seed: int = 0) -> list[tuple[MountedTask, ToolMotion, Paths]]:
    """Random scoops, each on an arm with random joint zeros of its own, as a session asks for them."""
    rng, found = np.random.default_rng(seed), list[tuple[MountedTask, ToolMotion, Paths]]()
    while len(found) < scoops:
        there = mounted_task_of(TASK, as_shipped("panda"), rng.uniform(-ZEROS_RAD, ZEROS_RAD, 7))
        motion = HARDWARE.plan(TASK.context.sample(rng, 1)[0], TASK.action.sample(rng, 1)[0])
        try:
            found.append((there, motion, there.planner().paths(motion)))
        except NotExecutable:
            continue
    return found


def refuses(cell: Workcell, path: Paths) -> bool:
    try:
        for part in path:
            cell.require(part, part.q_rad[0])
    except MotionRefused:
        return True
    return False


def test_an_arm_that_knows_its_zeros_refuses_no_scoop_that_was_planned():
    for there, _, paths in planned(SCOOPS):
        with InstantArm(there.home_rad, there.cell) as arm:
            for path in paths:
                there.planner().check(path)
                arm.execute(path)


def test_an_arm_that_takes_reported_joints_for_true_ones_refuses_some():
    exact = arm_model("panda", np.zeros(7))
    assert any(refuses(replace(there.cell, arm=exact), paths) for there, _, paths in planned(SCOOPS))


def test_the_tool_goes_where_it_was_meant_to_go():
    for there, motion, (_, path, _) in planned(SCOOPS):
        X_BT = forward(there.cell.arm.true_rad(path.q_rad)) @ HARDWARE.X_FT
        assert np.abs(X_BT - motion.X_BT).max() < 1e-6


@pytest.mark.slow
def test_no_scoop_of_a_hundred_is_refused():
    assert not any(refuses(there.cell, paths) for there, _, paths in planned(100, seed=1))
