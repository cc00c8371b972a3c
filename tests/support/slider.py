"""A task for tests of the lab: a box-shaped tool shoves a block along the table. Quick to build and to simulate.

With its workcell, its world, and whole trials of it in the simulated lab.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hw.joint_limits import LIMITS
from hw.mass import NOTHING
from hw.types import Array, Execution, Frame, JointPath, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.lab.simulated import SimulatedLab
from sim.lab.world import Faults, Sensing, World
from sim.panda.model import inverse
from sim.panda.moves import move_path
from sim.panda.tool import cell_as_shipped
from sim.tasks.hardware import Hardware, SceneBodies
from sim.tasks.task import AdaptationSettings, Observation, Task
from sim.types import Dimension, Space, ToolMotion, Visual

BLOCK_M = 0.04
TOOL_M = (0.02, 0.10, 0.04)
HOME_RAD = frozen_array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])

PARAMETERS = Space(
    (
        Dimension("mu", "", 0.1, 0.5),
        Dimension("e", "Pa", 1e4, 1e6, "log"),
        Dimension("kind", "", 0, 1, "integer"),
        Dimension("h", "cm", 1.5, 2.5),
        Dimension("y", "m", -0.1, 0.1),
    )
)
NUISANCE = Space((Dimension("radius", "m", 0.01, 0.02),))


@dataclass(frozen=True)
class Unmodelled:
    pitch_bias_rad: float = 0.0
    distance_bias_m: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)
    dt_s: float | None = None

    def __post_init__(self) -> None:
        if min(self.scale) <= 0:
            raise ValueError(f"scale = {self.scale} must be positive")


def build_scene(
    plant: Any, tool_parent: Any, X_PT: Array, parameters: Array, nuisance: Array, unmodelled: Any
) -> SceneBodies:
    from pydrake.geometry import (  # noqa: PLC0415
        AddCompliantHydroelasticProperties,
        AddContactMaterial,
        AddRigidHydroelasticProperties,
        Box,
        HalfSpace,
        ProximityProperties,
    )
    from pydrake.math import RigidTransform  # noqa: PLC0415
    from pydrake.multibody.plant import CoulombFriction, DiscreteContactApproximation  # noqa: PLC0415
    from pydrake.multibody.tree import SpatialInertia  # noqa: PLC0415

    rigid, soft = ProximityProperties(), ProximityProperties()
    for properties in (rigid, soft):
        AddContactMaterial(1.0, None, CoulombFriction(parameters[0], parameters[0]), properties)
    AddRigidHydroelasticProperties(1.0, rigid)
    AddCompliantHydroelasticProperties(BLOCK_M, 1e6, soft)
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "table", rigid)
    inertia = SpatialInertia.SolidBoxWithMass(0.05, BLOCK_M, BLOCK_M, BLOCK_M)
    block = plant.AddRigidBody("block", plant.AddModelInstance("block"), inertia)
    plant.RegisterCollisionGeometry(block, RigidTransform(), Box(BLOCK_M, BLOCK_M, BLOCK_M), "block", soft)
    instance = plant.AddModelInstance("tool")
    tool = plant.AddRigidBody("tool", instance, SpatialInertia.SolidBoxWithMass(0.1, *TOOL_M))
    plant.set_gravity_enabled(instance, False)
    plant.RegisterCollisionGeometry(tool, RigidTransform(), Box(*TOOL_M), "tool", rigid)
    plant.WeldFrames(tool_parent, tool.body_frame(), RigidTransform(X_PT))
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
    visuals = (
        box_visual("world", (1.2, 1.2, 0.1), (0.4, 0.0, -0.05), (0.5, 0.45, 0.4)),
        box_visual("block", (BLOCK_M, BLOCK_M, BLOCK_M), (0, 0, 0), (0.7, 0.1, 0.1)),
        box_visual("tool", TOOL_M, (0, 0, 0), (0.1, 0.1, 0.1)),
    )
    return SceneBodies("tool", "block", visuals)


def box_visual(
    body: str, size_m: tuple[float, ...], centre_m: tuple[float, ...], rgb: tuple[float, float, float]
) -> Visual:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    return Visual(body, corners * size_m + np.asarray(centre_m), np.array(triangles, dtype=np.int32), rgb)


def rest_pose(context: Array, parameters: Array, nuisance: Array, unmodelled: Any) -> Array:
    X_BO = np.eye(4)
    X_BO[:3, 3] = [context[0], context[1], BLOCK_M / 2]
    return X_BO


def plan(context: Array, action: Array) -> ToolMotion:
    """Forward by `action[0]` metres in one second along a smooth step, 25 mm above the table."""
    t_s = np.arange(1001) / 1000.0
    X_BT = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (len(t_s), 1, 1))
    X_BT[:, 0, 3] = context[0] - 0.05 + action[0] * t_s**3 * (10 - 15 * t_s + 6 * t_s**2)
    X_BT[:, 1, 3], X_BT[:, 2, 3] = context[1], 0.025
    return ToolMotion(t_s, X_BT)


def simulate(parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None) -> ObjectTrack:
    raise AssertionError("the lab runs this task with its own arm")


HARDWARE = Hardware(
    X_FT=frozen_array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0.15], [0, 0, 0, 1.0]]),
    tool_mass=NOTHING,
    keep_clear=(),
    plan=plan,
    build_scene=build_scene,
    time_step_s=lambda unmodelled: unmodelled.dt_s or 0.002,
    rest_pose=rest_pose,
    tracker="none",
)

TASK = Task(
    name="slider",
    title="Shove a block",
    parameters=PARAMETERS,
    margin=PARAMETERS,
    context=Space((Dimension("x", "m", 0.5, 0.6), Dimension("y", "m", -0.05, 0.05))),
    action=Space((Dimension("reach", "m", 0.0, 0.1),)),
    nuisance=NUISANCE,
    action_noise=frozen_array([0.0]),
    observation=Observation(
        frozen_array([0.0, 1.0]),
        (0, 1),
        frozen_array([0.4, -0.1]),
        frozen_array([0.8, 0.1]),
        frozen_array([0.0, 0.0]),
        frozen_array([0.0, 0.0]),
    ),
    adaptation=AdaptationSettings(8, 0.15, 0.9, 0.5, 2, 1e-3),
    unmodelled=Unmodelled,
    simulate=simulate,
    reference_context=frozen_array([0.55, 0.0]),
    relocate=lambda observation, context: observation,
    succeeded=lambda track: track.outcome is Outcome.SETTLED,
    end_state=lambda track: track.state[-1],
    reward_of_success=lambda end, context: np.ones(end.shape[:-1]),
    object_name="block",
    hardware=HARDWARE,
)


CELL = cell_as_shipped(HARDWARE, "panda")
XY_M = np.array([0.55, 0.0])


def world(sensing: Sensing | None = None, faults: Faults | None = None) -> World:
    return World(
        name="test",
        task="slider",
        description="",
        parameters=np.array([0.3, 1e5, 1, 2.0, 0.0]),
        nuisance=np.array([0.015]),
        unmodelled=Unmodelled(),
        sensing=sensing or Sensing(camera="small"),
        faults=faults or Faults(),
    )


def shove(xy_m: Array = XY_M) -> JointPath:
    motion = HARDWARE.plan(xy_m, np.array([0.08]))
    X_BF = motion.X_BT @ np.linalg.inv(HARDWARE.X_FT)
    return JointPath(motion.t_s, inverse(X_BF, np.zeros(len(motion.t_s)))[:, 0])


@dataclass(frozen=True)
class Trial:
    frames: tuple[Frame, ...]
    execution: Execution
    bytes_: bytes


def run(lab: SimulatedLab, trial: int, attempt: int = 0) -> Trial:
    """One whole trial, as a session does it."""
    path = shove()
    lab.bench.place(XY_M, trial, attempt)
    lab.arm.execute(move_path(HOME_RAD, path.q_rad[0], LIMITS["panda"]))
    lab.camera.start_recording()
    execution = lab.arm.execute(path)
    frames = tuple(lab.camera.stop_recording())
    images = b"".join(repr(f.t_s).encode() + f.colour.tobytes() + f.depth_mm.tobytes() for f in frames)
    return Trial(frames, execution, images + execution.q_measured_rad.tobytes() + repr(execution.t_start_s).encode())
