"""One training rollout: the spatula driven directly, through springs as stiff as the arm's.

Drake steps the plant; every 20 ms the poses are read. The rollout starts shortly before the edge reaches the piece
(before that nothing happens) and ends with the motion, or as soon as the piece rests where nothing moves it any more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.tasks.scooping.carriage import CARRIAGE, add_carriage, drive_of, place_carriage
from sim.tasks.scooping.params import BLADE_LENGTH_M, BLADE_WIDTH_M, PIECE_DENSITY_KG_M3, Unmodelled
from sim.tasks.scooping.plan import DURATION_S, plan
from sim.tasks.scooping.rest import lying, sink_m
from sim.tasks.scooping.scene import OBJECT, TOOL, build_scene, piece_of, time_step_s
from sim.types import ToolMotion

READ_EVERY_S = 0.020
LEAD_S = 0.030
"""How long before the edge reaches the piece the rollout starts."""

SETTLING_S = 0.70
"""From here on the tool all but rests; a piece that rests too is not simulated further."""

REST_SPEED_M_S = 0.003
REST_RATE_RAD_S = 0.1


@dataclass(frozen=True, eq=False)
class _Readings:
    t_s: tuple[float, ...]
    X_BO: tuple[RigidTransform, ...]
    X_BT: tuple[RigidTransform, ...]
    failure: str | None


def rest_pose(context: Array, parameters: Array, nuisance: Array, unmodelled: Unmodelled | None) -> Array:
    """(4, 4) pose X_BO of the piece lying ready on the table."""
    piece = piece_of(parameters, nuisance, unmodelled)
    mass_kg = PIECE_DENSITY_KG_M3 * piece.volume_m3 * (1.0 if unmodelled is None else unmodelled.density_scale)
    return lying(context, float(parameters[3]) / 200.0 - sink_m(piece, mass_kg, float(parameters[1])))


def simulate(
    parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Unmodelled | None = None
) -> ObjectTrack:
    """Scoop once (see `sim.tasks.task.Simulate`)."""
    motion = plan(context, action)
    drive = drive_of(motion)
    start_s = _start_s(motion, context, nuisance, unmodelled)
    diagram, plant = _diagram(drive, float(motion.X_BT[0, 1, 3]), parameters, nuisance, unmodelled)
    simulator = Simulator(diagram)
    simulator.get_mutable_context().SetTime(start_s)
    state = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    X_BO = rest_pose(context, parameters, nuisance, unmodelled)
    plant.SetFreeBodyPose(state, plant.GetBodyByName(OBJECT), RigidTransform(X_BO))
    place_carriage(plant, state, drive.value(start_s)[:, 0])
    return _track(_run(simulator, plant, start_s), motion)


def _start_s(motion: ToolMotion, context: Array, nuisance: Array, unmodelled: Unmodelled | None) -> float:
    """Shortly before the edge reaches the piece, on the grid of readings."""
    effects = unmodelled or Unmodelled()
    side_m = context[0] - nuisance[0] * effects.semi_axis_scale[0]
    reached = motion.X_BT[:, 0, 3] - effects.distance_bias_m >= side_m
    touch_s = float(motion.t_s[reached][0]) if reached.any() else 0.0
    return max(0.0, math.floor((touch_s - LEAD_S) / READ_EVERY_S) * READ_EVERY_S)


def _diagram(
    drive: PiecewisePolynomial, y_m: float, parameters: Array, nuisance: Array, unmodelled: Unmodelled | None
) -> tuple[Diagram, MultibodyPlant]:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=time_step_s(unmodelled))
    plant.SetUseSampledOutputPorts(False)  # nobody reads what they would keep
    carriage = add_carriage(plant, y_m)
    build_scene(plant, carriage, np.eye(4), parameters, nuisance, unmodelled)
    plant.Finalize()
    source = builder.AddSystem(TrajectorySource(drive))
    port = plant.get_desired_state_input_port(plant.GetModelInstanceByName(CARRIAGE))
    builder.Connect(source.get_output_port(), port)
    return builder.Build(), plant


def _run(simulator: Simulator, plant: MultibodyPlant, start_s: float) -> _Readings:
    state = plant.GetMyContextFromRoot(simulator.get_context())
    piece, tool = plant.GetBodyByName(OBJECT), plant.GetBodyByName(TOOL)
    t_s = [start_s]
    X_BO = [piece.EvalPoseInWorld(state)]
    X_BT = [tool.EvalPoseInWorld(state)]
    failure = None
    try:
        simulator.Initialize()
        while t_s[-1] < DURATION_S and not (t_s[-1] >= SETTLING_S and _rests(piece, tool, state)):
            t = min(start_s + len(t_s) * READ_EVERY_S, DURATION_S)
            simulator.AdvanceTo(t)
            t_s.append(t)
            X_BO.append(piece.EvalPoseInWorld(state))
            X_BT.append(tool.EvalPoseInWorld(state))
    except RuntimeError as error:  # what Drake's solvers raise
        failure = f"the solver failed after {t_s[-1]:.2f} s: {error}"
    return _Readings(tuple(t_s), tuple(X_BO), tuple(X_BT), failure)


def _rests(piece: RigidBody, tool: RigidBody, state: Context) -> bool:
    """Whether the piece rests on the blade or on the table."""
    V_BO, V_BT = piece.EvalSpatialVelocityInWorld(state), tool.EvalSpatialVelocityInWorld(state)
    p_TO_B = piece.EvalPoseInWorld(state).translation() - tool.EvalPoseInWorld(state).translation()
    carried = V_BT.Shift(p_TO_B)
    return any(
        np.linalg.norm(V_BO.translational() - v) < REST_SPEED_M_S
        and np.linalg.norm(V_BO.rotational() - w) < REST_RATE_RAD_S
        for v, w in ((carried.translational(), carried.rotational()), (np.zeros(3), np.zeros(3)))
    )


def _track(readings: _Readings, motion: ToolMotion) -> ObjectTrack:
    """The readings, held before the first one, and after the last one carried along by whatever the piece lies on."""
    t_s = np.array(readings.t_s)
    p_BO_m = np.array([X.translation() for X in readings.X_BO])
    p_TO_m = readings.X_BT[-1].inverse() @ readings.X_BO[-1].translation()
    outcome = Outcome.SOLVER_FAILED if readings.failure else _outcome(p_BO_m[-1], p_TO_m)
    if t_s[-1] < DURATION_S:
        later_s = np.append(np.arange(t_s[-1] + READ_EVERY_S, DURATION_S - 1e-9, READ_EVERY_S), DURATION_S)
        carried_m = _carried(motion, t_s[-1], later_s, p_BO_m[-1])
        on_blade = outcome is Outcome.ON_BLADE
        p_BO_m = np.concatenate([p_BO_m, carried_m if on_blade else np.tile(p_BO_m[-1], (len(later_s), 1))])
        t_s = np.concatenate([t_s, later_s])
    if t_s[0] > 0.0:
        t_s, p_BO_m = np.concatenate([[0.0], t_s]), np.concatenate([p_BO_m[:1], p_BO_m])
    flags = () if readings.failure is None else (readings.failure,)
    return ObjectTrack(t_s, p_BO_m, outcome, p_TO_m, np.ones(len(t_s)), flags)


def _carried(motion: ToolMotion, from_s: float, to_s: Array, p_B_m: Array) -> Array:
    """(M, 3) where a point ends up that moves with the tool from `from_s` to each of `to_s`."""
    indices = np.searchsorted(motion.t_s, np.append(to_s, from_s) - 1e-9)
    X_BT = motion.X_BT[np.minimum(indices, len(motion.t_s) - 1)]
    p_T = np.linalg.inv(X_BT[-1]) @ np.append(p_B_m, 1.0)
    carried: Array = (X_BT[:-1] @ p_T)[:, :3]
    return carried


def _outcome(p_BO_m: Array, p_TO_m: Array) -> Outcome:
    if p_TO_m[2] > 0.001 and -BLADE_LENGTH_M <= p_TO_m[0] <= 0.0 and abs(p_TO_m[1]) <= BLADE_WIDTH_M / 2:
        return Outcome.ON_BLADE
    return Outcome.ON_TABLE if p_BO_m[2] > 0.0 else Outcome.LOST
