"""The carriage of a training rollout gives way as the lab's arm does where the edge touches the table."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from hw.kinematics import jacobian
from sim.lab.cell import DAMPING_NMS_RAD, STIFFNESS_NM_RAD
from sim.panda.model import add_panda
from sim.panda.planning import home, trial_paths
from sim.panda.tool import cell_as_shipped
from sim.tasks.scooping import HARDWARE, TASK
from sim.tasks.scooping.plan import VERTICAL_STIFFNESS_N_M
from sim.tasks.scooping.rollout import ARM

TOUCHING_S = (0.20, 0.25, 0.30, 0.35, 0.40)
IN_PLANE = [0, 2, 4]  # X, Z, and the turn about Y


@pytest.fixture(scope="module")
def arm_at_edge():
    """Mean compliance, mobility of the dampers, inverse mass (3, 3) at the edge, in tool axes, over planned scoops."""
    plant = MultibodyPlant(0.001)
    add_panda(plant)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    cell = cell_as_shipped(HARDWARE, "panda")
    q_home_rad = home(HARDWARE.X_FT, cell)
    rng = np.random.default_rng(1)
    found = []
    for _ in range(3):
        motion = HARDWARE.plan(TASK.context.sample(rng, 1)[0], TASK.action.sample(rng, 1)[0])
        path = trial_paths(motion, HARDWARE.X_FT, cell, q_home_rad)[1]
        for t_s in TOUCHING_S:
            k = round(1000 * t_s)
            J = jacobian(path.q_rad[k], HARDWARE.X_FT[:3, 3])[IN_PLANE]
            R_BT = motion.X_BT[k][:3, :3]
            J[:2] = R_BT[np.ix_([0, 2], [0, 2])].T @ J[:2]
            plant.SetPositions(context, path.q_rad[k])
            M = plant.CalcMassMatrix(context)
            parts = (np.diag(1 / np.array(STIFFNESS_NM_RAD)), np.diag(1 / np.array(DAMPING_NMS_RAD)), np.linalg.inv(M))
            found.append([J @ W @ J.T for W in parts])
    return np.mean(found, axis=0)


def at_edge(inverse_at_P):
    """What stands at P, seen from the origin of T: a turn about P moves it."""
    x_m, z_m = ARM.p_TP_m
    A = np.array([[1.0, 0.0, -z_m], [0.0, 1.0, x_m], [0.0, 0.0, 1.0]])
    return A @ inverse_at_P @ A.T


def relative(found, wanted):
    """Difference of two (3, 3) in units of the diagonal of `wanted`."""
    scale = np.sqrt(np.diag(wanted))
    return np.abs(found - wanted) / np.outer(scale, scale)


@pytest.mark.long
def test_springs(arm_at_edge):
    assert relative(at_edge(np.diag(1.0 / np.array(ARM.stiffness))), arm_at_edge[0]).max() < 0.1


def test_dampers(arm_at_edge):
    assert relative(at_edge(np.diag(1.0 / np.array(ARM.damping))), arm_at_edge[1]).max() < 0.25


def test_mass(arm_at_edge):
    x_m, z_m = ARM.p_PM_m
    m = ARM.mass_kg
    M = np.array([[m, 0, m * z_m], [0, m, -m * x_m], [m * z_m, -m * x_m, ARM.inertia_kg_m2 + m * (x_m**2 + z_m**2)]])
    assert relative(at_edge(np.linalg.inv(M)), arm_at_edge[2]).max() < 0.1


def test_an_edge_that_is_lifted_yields_as_planning_assumes():
    assert 1.0 / ARM.lift_m_N(0.1) == pytest.approx(VERTICAL_STIFFNESS_N_M, rel=0.1)
    forward, up, turn = ARM.yielding(0.1)
    x_m, z_m = ARM.p_TP_m
    cos, sin = np.cos(0.1), np.sin(0.1)
    assert forward == 0.0
    assert up - turn * -(cos * x_m + sin * z_m) == pytest.approx(ARM.lift_m_N(0.1))
