"""The arm's own dynamics against Drake's, which is built from the same masses by a URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml  # type: ignore[import-untyped]
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, SpatialInertia, UnitInertia

from hw.collision import HAND_MASS
from hw.dynamics import LINKS, demand_of, torque_Nm
from hw.joint_limits import LIMITS
from hw.mass import Mass
from sim.panda.model import FLANGE_NAME, add_panda

STATES = 300
LOAD = Mass(
    1.7, np.array([0.03, -0.05, 0.18]), np.array([[0.02, 0.003, 0.001], [0.003, 0.03, 0.002], [0.001, 0.002, 0.02]])
)


def drake(model: str, load: Mass | None) -> tuple[Any, Any]:
    """The arm with its hand and, welded to its flange, a body of `load`."""
    plant = MultibodyPlant(0.0)
    instance = add_panda(plant, model)
    if load is not None:
        com: Any = load.com_m
        moments = load.inertia_kg_m2 / load.kg
        unit = UnitInertia(moments[0, 0], moments[1, 1], moments[2, 2], moments[0, 1], moments[0, 2], moments[1, 2])
        inertia = SpatialInertia(load.kg, com, unit.ShiftFromCenterOfMass(com))
        body = plant.AddRigidBody("load", instance, inertia)
        plant.WeldFrames(plant.GetFrameByName(FLANGE_NAME), body.body_frame())
    plant.Finalize()
    return plant, plant.CreateDefaultContext()


def states(model: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng, limits = np.random.default_rng(7), LIMITS[model]
    q = rng.uniform(limits.q_min_rad, limits.q_max_rad, (STATES, 7))
    return (
        q,
        rng.uniform(-1.0, 1.0, (STATES, 7)) * limits.dq_max_rad_s,
        rng.uniform(-1.0, 1.0, (STATES, 7)) * limits.ddq_max_rad_s2,
    )


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
@pytest.mark.parametrize("load", [None, LOAD], ids=["hand", "hand and load"])
def test_torques_are_those_of_drake(model: str, load: Mass | None) -> None:
    plant, context = drake(model, load)
    q, dq, ddq = states(model)
    hand = HAND_MASS.placed(_hand_in_flange())
    ours = torque_Nm(model, q, dq, ddq, hand if load is None else hand + load)
    for row in range(STATES):
        plant.SetPositions(context, q[row])
        plant.SetVelocities(context, dq[row])
        forces = plant.CalcInverseDynamics(context, ddq[row], _no_forces(plant))
        gravity = plant.CalcGravityGeneralizedForces(context)
        np.testing.assert_allclose(ours[row], forces - gravity, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_the_flange_travels_as_in_drake(model: str) -> None:
    plant, context = drake(model, None)
    q, dq, ddq = states(model)
    found = demand_of(model, q, dq, ddq, HAND_MASS)
    flange, world = plant.GetFrameByName(FLANGE_NAME), plant.world_frame()
    for row in range(STATES):
        plant.SetPositions(context, q[row])
        plant.SetVelocities(context, dq[row])
        velocity = flange.CalcSpatialVelocityInWorld(context)
        np.testing.assert_allclose(found.flange_m_s[row], velocity.translational(), atol=1e-9)
        np.testing.assert_allclose(found.flange_rad_s[row], velocity.rotational(), atol=1e-9)
        bias = plant.CalcBiasSpatialAcceleration(context, JacobianWrtVariable.kV, flange, np.zeros(3), world, world)
        J = plant.CalcJacobianSpatialVelocity(context, JacobianWrtVariable.kV, flange, np.zeros(3), world, world)
        spatial = J @ ddq[row]
        np.testing.assert_allclose(found.flange_m_s2[row], spatial[3:] + bias.translational(), atol=1e-8)
        np.testing.assert_allclose(found.flange_rad_s2[row], spatial[:3] + bias.rotational(), atol=1e-8)


def _hand_in_flange() -> np.ndarray:
    """The URDF turns the hand by -45°; `HAND_MASS` is said in the flange's own axes."""
    X = np.eye(4)
    c = np.sqrt(0.5)
    X[:2, :2] = [[c, c], [-c, c]]
    return X


def _no_forces(plant: MultibodyPlant) -> object:
    from pydrake.multibody.tree import MultibodyForces  # noqa: PLC0415

    return MultibodyForces(plant)


DESCRIPTION = Path(__file__).parents[1] / "data" / "franka-description"


@pytest.mark.parametrize(("model", "moving_kg"), [("fr3", 15.4948), ("fr3v2", 13.4622)])
def test_an_arm_has_the_masses_that_its_maker_publishes(model: str, moving_kg: float) -> None:
    published = yaml.safe_load((DESCRIPTION / model / "inertials.yaml").read_text())
    for number, link in enumerate(LINKS[model]):
        body = published[f"link{number}"]
        found = body["inertia"].get("inertia", body["inertia"])
        assert body["origin"]["rpy"] == "0 0 0"
        assert link.kg == body["mass"]
        np.testing.assert_allclose(link.com_m, [float(v) for v in body["origin"]["xyz"].split()], rtol=1e-6)
        tensor = [[found["".join(sorted(row + column))] for column in "xyz"] for row in "xyz"]
        np.testing.assert_allclose(link.inertia_kg_m2, tensor, rtol=1e-6)
    assert sum(link.kg for link in LINKS[model][1:]) == pytest.approx(moving_kg, abs=1e-4)


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_every_link_is_a_body_that_exists(model: str) -> None:
    """No principal moment of a body exceeds the sum of the other two."""
    for link in LINKS[model]:
        moments = np.linalg.eigvalsh(link.inertia_kg_m2)
        assert moments[0] > 0.0
        assert moments[2] <= moments[0] + moments[1] + 1e-9
