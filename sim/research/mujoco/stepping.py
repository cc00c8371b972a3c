"""A rollout without an arm, in MuJoCo: the same carriage, springs, readings and judgement as in Drake."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix

from hw.types import Array
from sim.tasks.shared.carriage import Drive
from sim.tasks.shared.readings import Course, Moment, Readings, Velocity, read

TOOL, OBJECT = "tool", "object"
_JOINTS = ("forward", "up", "pitch")
_BAD = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)

IMPRATIO = 10.0
"""Friction is stiffer than the normal contact by this factor, so that an object on a slope creeps a tenth as fast."""


_log = mujoco.MjLogConfig.get()
_log.logto_console = _log.logto_file = False  # `_MuJoCo.advance_to` reports errors, so no log file
_log.set()


def new_scene(gravity_m_s2: Array) -> Any:
    """An empty MjSpec: contacts only between named pairs, with elliptic cones, solved to convergence."""
    spec = mujoco.MjSpec()
    option = spec.option
    option.gravity = gravity_m_s2
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # the carriage's dampers are stiff
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = IMPRATIO
    option.tolerance, option.iterations = 1e-10, 100
    option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)  # a failure is reported, not reset
    return spec


def add_carriage(spec: Any, drive: Drive) -> Any:
    """Add the carriage and return a body at the frame T that it carries. Both are weightless."""
    arm = drive.compliance
    pose = RigidTransform(drive.X_BP)
    carriage = spec.worldbody.add_body(name="carriage", pos=pose.translation(), quat=quaternion(pose))
    carriage.gravcomp = 1.0
    set_inertia(carriage, arm.mass_kg, (arm.p_PM_m[0], 0.0, arm.p_PM_m[1]), arm.inertia_kg_m2 * np.eye(3))
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    kinds = ((slide, (1.0, 0.0, 0.0)), (slide, (0.0, 0.0, 1.0)), (hinge, (0.0, 1.0, 0.0)))
    for name, (kind, axis), stiffness, damping in zip(_JOINTS, kinds, arm.stiffness, arm.damping, strict=True):
        carriage.add_joint(name=name, type=kind, axis=axis)
        spring = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        spring.gaintype, spring.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        spring.gainprm[0] = 1.0  # the control is the force for the wanted place and speed
        spring.biasprm[1], spring.biasprm[2] = -stiffness, -damping
    tool = carriage.add_body(name="carriage_tool", pos=(-arm.p_TP_m[0], 0.0, -arm.p_TP_m[1]))
    tool.gravcomp = 1.0
    return tool


def set_inertia(body: Any, mass_kg: float, centre_m: Any, central_kg_m2: Array) -> None:
    """Set mass, centre of mass in the body's frame, and inertia (3, 3) about that centre."""
    M = central_kg_m2
    body.mass, body.ipos, body.explicitinertial = mass_kg, centre_m, True
    body.fullinertia = (M[0, 0], M[1, 1], M[2, 2], M[0, 1], M[0, 2], M[1, 2])


def quaternion(pose: RigidTransform) -> Array:
    """The quaternion (4,) of a pose: w, x, y, z."""
    return np.asarray(pose.rotation().ToQuaternion().wxyz())


def run(course: Course, model: Any, step_s: float, before_step: Callable[[Any, Any], None] | None = None) -> Readings:
    """Step a compiled model, with a carriage and bodies called `TOOL` and `OBJECT`, through the course.

    `before_step` (model, data) may change properties that depend on positions. A solver failure is noted in the
    readings, never raised.
    """
    data = mujoco.MjData(model)
    set_state(model, data, course.X_BO, course.tool)
    mujoco.mj_forward(model, data)
    return read(_MuJoCo(model, data, course, step_s, before_step), course)


def set_state(model: Any, data: Any, X_BO: Array, tool: Array) -> None:
    """Put the object at X_BO (4, 4), at rest, and the carriage at `tool` (6,): forward, up, pitch and their rates."""
    for name, q, rate in zip(_JOINTS, tool[:3], tool[3:], strict=True):
        data.joint(name).qpos, data.joint(name).qvel = q, rate
    pose = RigidTransform(X_BO)
    data.joint(OBJECT).qpos = np.concatenate([pose.translation(), quaternion(pose)])


def written(spec: Any, model: Any, course: Course) -> str:
    """The MJCF of a scene, with the softness of its compiled model, and with a keyframe "start" at the beginning of the
    course.
    """
    for pair in spec.pairs:
        compiled = model.pair(pair.name)
        pair.solref, pair.solimp = compiled.solref, compiled.solimp
    data = mujoco.MjData(model)
    set_state(model, data, course.X_BO, course.tool)
    spec.add_key(name="start", time=course.start_s, qpos=data.qpos, qvel=data.qvel)
    spec.compile()
    return str(spec.to_xml())


class _MuJoCo:
    def __init__(
        self, model: Any, data: Any, course: Course, step_s: float, before_step: Callable[[Any, Any], None] | None
    ) -> None:
        self._model, self._data, self._drive = model, data, course.drive
        self._step_s, self._before, self._t_s = step_s, before_step, course.start_s
        self._object, self._tool = (model.body(name).id for name in (OBJECT, TOOL))

    def now(self, t_s: float) -> Moment:
        mujoco.mj_kinematics(self._model, self._data)  # a step leaves the poses of its beginning
        mujoco.mj_comPos(self._model, self._data)
        thing, tool = self._object, self._tool
        return Moment(t_s, self._pose(thing), self._pose(tool), self._velocity(thing), self._velocity(tool))

    def advance_to(self, t_s: float) -> None:
        """Step in equal steps, none longer than the wanted step."""
        n = math.ceil((t_s - self._t_s) / self._step_s - 1e-9)
        dt_s = (t_s - self._t_s) / n
        self._model.opt.timestep = dt_s
        forces = self._wanted(self._t_s + dt_s * np.arange(n, dtype=np.float64))
        for force in forces:
            if self._before is not None:
                self._before(self._model, self._data)
            self._data.ctrl[:] = force
            mujoco.mj_step(self._model, self._data)
        self._t_s = t_s
        failed = [warning.name for warning in _BAD if self._data.warning[warning].number]
        if failed or not np.isfinite(self._data.qpos).all():
            raise RuntimeError(f"MuJoCo's state is no longer finite, or is huge ({', '.join(failed) or 'qpos'})")

    def _wanted(self, t_s: Array) -> Array:
        """(n, 3) the force of each spring and damper for a carriage at zero and at rest."""
        arm = self._drive.compliance
        x = np.asarray(self._drive.trajectory.vector_values(t_s.tolist())).T
        return np.asarray(x[:, :3] * np.array(arm.stiffness) + x[:, 3:] * np.array(arm.damping))

    def _pose(self, body: int) -> RigidTransform:
        R = RotationMatrix(Quaternion(self._data.xquat[body] / np.linalg.norm(self._data.xquat[body])))
        return RigidTransform(R, self._data.xpos[body])

    def _velocity(self, body: int) -> Velocity:
        linear, angular = (np.zeros((3, self._model.nv)) for _ in range(2))
        mujoco.mj_jacBody(self._model, self._data, linear, angular, body)
        return linear @ self._data.qvel, angular @ self._data.qvel
