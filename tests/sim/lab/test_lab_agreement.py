"""With nothing unmodelled, the lab's arm does what the training rollout says: the gap that is left is the arm's."""

from __future__ import annotations

import numpy as np
import pytest

from perception.types import Outcome
from sim.lab.cell import Cell
from sim.lab.world import Faults, Sensing, World
from sim.panda.planning import home, joint_path, trial_paths
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

BLADE_M = (0.10, 0.04)  # length, half width


@pytest.mark.slow
def test_nominal_scoops_end_as_in_training() -> None:
    task = get_task("scooping")
    rng = np.random.default_rng(0)
    agree, distance_mm = [], []
    for _ in range(30):
        parameters, context, action, nuisance = (
            space.sample(rng, 1)[0] for space in (task.parameters, task.context, task.action, task.nuisance)
        )
        expected = task.simulate(parameters, context, action, nuisance)
        effects = task.unmodelled()
        cell = Cell(task, World("nominal", task.name, "", parameters, nuisance, effects, Sensing(), Faults()))
        motion = task.plan(context, action)
        q_rad = joint_path(motion, task.X_FT, cell_as_shipped(task, "panda")).q_rad
        cell.reset(q_rad[0], task.rest_pose(context, parameters, nuisance, effects))
        played = cell.simulate(motion.t_s, q_rad)
        times_s = task.observation.times_s
        poses = cell.poses(played.at(times_s))
        X_BT, X_BO = poses[cell.bodies.tool], poses[cell.bodies.object]
        x_m, y_m, z_m = (np.linalg.inv(X_BT[-1]) @ X_BO[-1])[:3, 3]
        on_blade = z_m > 0.001 and -BLADE_M[0] <= x_m <= 0.0 and abs(y_m) <= BLADE_M[1]
        agree.append(on_blade == (expected.outcome is Outcome.ON_BLADE))
        if on_blade and agree[-1]:
            distance_mm.append(1e3 * np.linalg.norm(X_BO[-1, :2, 3] - expected.at(times_s)[-1, :2]))
    assert np.mean(agree) >= 0.85
    assert np.median(distance_mm) < 6.0


@pytest.mark.slow
def test_nominal_pushes_end_as_in_training() -> None:
    task = get_task("pushing")
    shipped, effects = cell_as_shipped(task, "panda"), task.unmodelled()
    q_home = home(task.X_FT, shipped)
    rng = np.random.default_rng(0)
    agree, distance_mm = [], []
    for _ in range(20):
        parameters, context, action, nuisance = (
            space.sample(rng, 1)[0] for space in (task.parameters, task.context, task.action, task.nuisance)
        )
        expected = task.simulate(parameters, context, action, nuisance)
        cell = Cell(task, World("nominal", task.name, "", parameters, nuisance, effects, Sensing(), Faults()))
        path = trial_paths(task.plan(context, action), task.X_FT, shipped, q_home)[1]
        cell.reset(path.q_rad[0], task.rest_pose(context, parameters, nuisance, effects))
        cell.simulate(path.t_s, path.q_rad)
        agree.append((cell.X_BO[2, 2] > np.cos(np.deg2rad(30.0))) == (expected.outcome is Outcome.UPRIGHT))
        if expected.outcome is Outcome.UPRIGHT and agree[-1]:
            distance_mm.append(1e3 * np.linalg.norm(cell.X_BO[:2, 3] - expected.state[-1, :2]))
    assert np.mean(agree) >= 0.9
    assert np.median(distance_mm) < 8.0
