"""A cube falls on a table, in Drake: the cube is compliant hydroelastic, the table a rigid half space.

The cube is that of ContactNets (Pfrommer, Halm, Posa, CoRL 2020). The time step is a part of the model: with 1 ms a
cube of the same dissipation bounces much longer (docs/results/tosses.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Box, HalfSpace
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from scipy.spatial.transform import Rotation

from hw.types import Array
from perception.types import REST_M_S, REST_RAD_S
from sim.tasks.shared.contact import coefficient, compliant, rigid, set_contact, vector

EDGE_M, MASS_KG, INERTIA_KG_M2 = 0.1048, 0.37, 0.00081
GRAVITY_M_S2 = 9.81
STEP_S, READING_S = 0.005, 0.02
LIMIT_S = 1.6
"""A toss that has not come to rest by then is judged where it is."""

_CUBE_COEFFICIENT = 1.0  # the table has the coefficient that gives the pair's friction


@dataclass(frozen=True, eq=False)
class Flight:
    """The poses of one cube over time."""

    t_s: Array  # (N,) from the start
    position_m: Array  # (N, 3) of the centre, table at z = 0
    rotation: Array  # (N, 4) quaternion x, y, z, w


class Table:
    """One table and its cube, built once for many tosses."""

    def __init__(self, mu: float, modulus_Pa: float, dissipation_s_m: float, slope_rad: float = 0.0) -> None:
        builder = DiagramBuilder()
        self._plant, _ = AddMultibodyPlantSceneGraph(builder, STEP_S)
        _add_scene(self._plant, mu, modulus_Pa, dissipation_s_m, slope_rad)
        self._plant.Finalize()
        self._diagram: Diagram = builder.Build()
        self._cube = self._plant.GetBodyByName("cube")

    def toss(self, start: Array) -> Flight:
        """Let the cube go in the state `start` (12,): rotation vector rad, position m, angular velocity in the body
        frame rad/s, velocity m/s. Raises RuntimeError if the solver fails.
        """
        simulator = Simulator(self._diagram)
        context = self._plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        R_WC = Rotation.from_rotvec(start[:3]).as_matrix()
        self._plant.SetFreeBodyPose(context, self._cube, RigidTransform(RotationMatrix(R_WC), vector(*start[3:6])))
        moving = SpatialVelocity(vector(*(R_WC @ start[6:9])), vector(*start[9:12]))
        self._plant.SetFreeBodySpatialVelocity(context=context, body=self._cube, V_JpJc=moving)
        seen, t_s, rested = [self._state(context)], 0.0, False
        while not rested and t_s < LIMIT_S - 1e-9:
            t_s += READING_S
            simulator.AdvanceTo(t_s)
            seen.append(self._state(context))
            spin, slide = seen[-1][7:10], seen[-1][10:13]
            rested = math.hypot(*slide) < REST_M_S and math.hypot(*spin) < REST_RAD_S
        states = np.array(seen)
        t = np.asarray(np.arange(len(states)) * READING_S, dtype=np.float64)
        return Flight(t, states[:, 4:7], states[:, [1, 2, 3, 0]])

    def _state(self, context: object) -> Array:
        return np.array(self._plant.GetPositionsAndVelocities(context))


def _add_scene(plant: MultibodyPlant, mu: float, modulus_Pa: float, dissipation_s_m: float, slope_rad: float) -> None:
    set_contact(plant, "lagged")
    down = vector(-math.sin(slope_rad), 0.0, -math.cos(slope_rad))
    plant.mutable_gravity_field().set_gravity_vector(GRAVITY_M_S2 * down)
    gyration = INERTIA_KG_M2 / MASS_KG
    inertia = SpatialInertia(MASS_KG, vector(0.0, 0.0, 0.0), UnitInertia(gyration, gyration, gyration))
    cube = plant.AddRigidBody("cube", inertia)
    soft = compliant(_CUBE_COEFFICIENT, modulus_Pa, resolution_m=EDGE_M, dissipation_s_m=dissipation_s_m)
    plant.RegisterCollisionGeometry(cube, RigidTransform(), Box(EDGE_M, EDGE_M, EDGE_M), "cube", soft)
    hard = rigid(coefficient(mu, _CUBE_COEFFICIENT))
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "table", hard)
