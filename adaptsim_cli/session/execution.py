"""The middle of a trial: plan and check the motion, execute and record it, track the object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.parts import Parts, Paths, TrackRequest
from hw.types import Array, Execution, Frame
from perception.types import ObjectTrack
from sim.types import ToolMotion


@dataclass(frozen=True, eq=False)
class Ready:
    """The object lies in the area and was found there."""

    drawn: Array  # (c,) the context that was asked for
    context: Array  # (c,) as measured
    frame: Frame  # in which it was found
    detection: Any
    overlay: bytes  # JPEG of what was found


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion that passed every limit."""

    motion: ToolMotion
    paths: Paths  # approach, motion, way back

    @property
    def duration_s(self) -> float:
        return sum(path.duration_s for path in self.paths)


@dataclass(frozen=True, eq=False)
class Executed:
    """What arm and camera say of one motion."""

    plan: Plan
    execution: Execution
    frames: tuple[Frame, ...]
    X_BT_at: Callable[[float], Array]  # arm clock -> measured tool pose (4, 4)


def plan(parts: Parts, context: Array, action: Array) -> Plan:
    """Raises NotExecutable, or MotionRefused naming joint, time, value and limit."""
    if parts.task.plan is None:
        raise UsageError(f"the task {parts.task.name} has no motion for a robot arm; it runs in simulation only")
    motion = parts.task.plan(context, action)
    paths = parts.planner.paths(motion)
    for path in paths:
        parts.planner.check(path, parts.rig.arm.model)
    return Plan(motion, paths)


def execute(parts: Parts, plan: Plan) -> Executed:
    """Approach, record the motion, go back. Raises MotionRefused, ArmFault, CameraError."""
    approach, motion, back = plan.paths
    arm, camera = parts.rig.arm, parts.rig.camera
    arm.execute(approach)
    camera.start_recording()
    played = arm.execute(motion)
    frames = tuple(camera.stop_recording())
    arm.execute(back)
    return Executed(plan, played, frames, tool_pose(parts, played))


def track(parts: Parts, executed: Executed, detection: Any) -> ObjectTrack:
    """Raises TrackingFailed."""
    return parts.tracker.track(
        TrackRequest(
            frames=executed.frames,
            model=parts.rig.camera.model(),
            X_BC=parts.rig.hand_eye.X_BC,
            detection=detection,
            X_BT_at=executed.X_BT_at,
            t_start_s=executed.execution.t_start_s,
            duration_s=float(executed.plan.motion.t_s[-1]),
        )
    )


def tool_pose(parts: Parts, played: Execution) -> Callable[[float], Array]:
    """Arm clock -> tool pose in the base frame, from the measured joints; held beyond the ends."""

    def X_BT_at(t_s: float) -> Array:
        since_s = t_s - played.t_start_s
        q_rad = np.array([np.interp(since_s, played.t_s, joint) for joint in played.q_measured_rad.T])
        return parts.planner.flange(q_rad) @ parts.task.X_FT

    return X_BT_at
