"""A trial on a rig: place the object, find it, plan and check the motion, execute and record it, track the object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from adaptsim_cli.errors import UsageError
from adaptsim_cli.session import moments, recording
from adaptsim_cli.session.clear import clear_to_move, top_speed_m_s
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.parts import Paths, Planner, Rig, Tracker, TrackRequest
from adaptsim_cli.session.preflight import Check, rig_checks
from adaptsim_cli.session.records import RigFacts, to_json
from adaptsim_cli.session.stages import RunTrial, TrialKey
from adaptsim_cli.session.target import Evidence
from hw.types import Array, Execution, Frame
from perception.errors import ObjectNotFound
from perception.types import ObjectTrack, Outcome
from sim.tasks.task import Task
from sim.types import ToolMotion

SETTLE_S = 2.0
"""How long a recording goes on after the motion: what was pushed slides or falls until it rests."""


@dataclass(frozen=True)
class OnRig:
    """A `Target`: a bench with an arm and a camera, real or of the simulated lab."""

    task: Task
    rig: Rig
    tracker: Tracker
    planner: Planner
    facts: Callable[[], RigFacts] | None = None
    """What a real rig says of itself after a trial; None: nothing is kept."""

    @property
    def title(self) -> str:
        return self.rig.title

    @property
    def is_real(self) -> bool:
        return self.rig.is_real

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        return self.tracker.outcomes

    def checks(self) -> tuple[Check, ...]:
        return rig_checks(self.rig)

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """The arm may have moved: a person is asked first, and on a real arm the attempt does not come back."""
        operator.repeat_interrupted(stage, self.is_real)
        return self.is_real

    def set_up(self, drawn: Array, key: TrialKey, operator: Operator) -> Found:
        """Have the object placed, find it, and check that it lies in the area."""
        task, rig, tracker = self.task, self.rig, self.tracker
        wanted_m = tracker.placement(drawn)
        operator.placed(task.object_name, wanted_m, rig.is_real)
        rig.bench.place(wanted_m, key.number, key.attempt)
        frame, model = self.in_time(rig.camera.snapshot()), rig.camera.model()
        detection = tracker.find(frame, model, rig.hand_eye.X_BC)
        context = tracker.context(drawn, detection)
        if not task.context.contains(context):
            ranges = ", ".join(f"{d.label} {d.low:g} to {d.high:g}" for d in task.context.dimensions)
            found = ", ".join(f"{value:.3f}" for value in context)
            raise ObjectNotFound(f"the {task.object_name} lies outside of the area: found {found}; area {ranges}")
        overlay = tracker.overlay(frame, model, rig.hand_eye.X_BC, detection, drawn)
        return Found(self, drawn, context, frame, detection, recording.encode_jpeg(overlay, 90))

    def in_time(self, frame: Frame) -> Frame:
        """A frame whose stamp is of the arm's clock: without what calibration found the camera's to be late by."""
        return replace(frame, t_s=frame.t_s - self.rig.hand_eye.camera_late_s)


@dataclass(frozen=True, eq=False)
class Found:
    """The object lies in the area and was found there."""

    target: OnRig
    drawn: Array  # (c,) the context that was asked for
    context: Array  # (c,) as measured
    frame: Frame  # in which it was found
    detection: Any
    overlay: bytes  # JPEG of what was found

    def plan(self, action: Array) -> MotionPlan:
        """Three paths that passed every limit."""
        task, planner = self.target.task, self.target.planner
        if task.plan is None:
            raise UsageError(f"the task {task.name} has no motion for a robot arm; it runs in simulation only")
        motion = task.plan(self.context, action)
        paths = planner.paths(motion)
        for path in paths:
            planner.check(path, self.target.rig.arm.model)
        return MotionPlan(self, motion, paths)


@dataclass(frozen=True, eq=False)
class MotionPlan:
    """A motion that passed every limit."""

    found: Found
    motion: ToolMotion
    paths: Paths  # approach, motion, way back
    doing: str = "The robot moves and the camera records"

    @property
    def duration_s(self) -> float:
        return sum(path.duration_s for path in self.paths)

    @property
    def told(self) -> str:
        return f"The motion takes {self.duration_s:.1f} s and passed all limits"

    @property
    def announced(self) -> str:
        target = self.found.target
        flange, X_FT = target.planner.flange, target.task.X_FT
        speed_m_s = top_speed_m_s(self.paths, lambda q_rad: flange(q_rad) @ X_FT)
        what = f"comes to the {target.task.object_name}, makes its motion and goes back"
        return clear_to_move(target.is_real, what, self.duration_s, speed_m_s)

    def execute(self) -> Recorded:
        """Approach, record the motion, go back."""
        approach, motion, back = self.paths
        rig = self.found.target.rig
        arm, camera = rig.arm, rig.camera
        arm.execute(approach)
        camera.start_recording()
        played = arm.execute(motion)
        rig.wait(SETTLE_S)
        frames = tuple(map(self.found.target.in_time, camera.stop_recording()))
        arm.execute(back)
        return Recorded(self.found, self.motion, played, frames)


@dataclass(frozen=True, eq=False)
class Recorded:
    """What arm and camera say of one motion."""

    found: Found
    motion: ToolMotion
    played: Execution
    frames: tuple[Frame, ...]

    @property
    def looking(self) -> str:
        return f"Tracking the {self.found.target.task.object_name} in {len(self.frames)} frames"

    def track(self) -> ObjectTrack:
        target = self.found.target
        return target.tracker.track(
            TrackRequest(
                frames=self.frames,
                model=target.rig.camera.model(),
                X_BC=target.rig.hand_eye.X_BC,
                detection=self.found.detection,
                X_BT_at=self._tool_pose(),
                q_at=joints(self.played),
                t_start_s=self.played.t_start_s,
                duration_s=float(self.motion.t_s[-1]),
            )
        )

    def evidence(self, track: ObjectTrack) -> Evidence:
        """Recording, overlay and the frames of the key moments."""
        rig, found, played = self.found.target.rig, self.found, self.played
        model, X_BC = rig.camera.model(), rig.hand_eye.X_BC
        wanted = moments.moments(self.motion.t_s[-1], self.motion.contact, float(track.t_s[-1]))
        seen_m = np.array([[*found.detection.xy_m, 0.0], *track.state[:, :3]])
        fallen = track.outcome is Outcome.TIPPED
        kept, images = moments.key_frames(self.frames, model, X_BC, seen_m, played.t_start_s, wanted, fallen=fallen)
        late_s = rig.hand_eye.camera_late_s
        mcap = recording.encode(found.frame, self.frames, model, X_BC, played, self._tool_pose(), track, late_s)
        facts = found.target.facts
        told = {} if facts is None else {"rig.json": to_json(facts())}
        files = {recording.FILE: mcap, "overlay.jpg": found.overlay, **images, **told}
        return Evidence(files, kept, played.control_success_rate)

    def _tool_pose(self) -> Callable[[float], Array]:
        """Arm clock -> tool pose in the base frame, from the measured joints; held beyond the ends."""
        q_at, flange, X_FT = joints(self.played), self.found.target.planner.flange, self.found.target.task.X_FT
        return lambda t_s: flange(q_at(t_s)) @ X_FT


def joints(played: Execution) -> Callable[[float], Array]:
    """Arm clock -> measured joints (7,), held beyond the ends."""

    def q_at(t_s: float) -> Array:
        since_s = t_s - played.t_start_s
        return np.array([np.interp(since_s, played.t_s, joint) for joint in played.q_measured_rad.T])

    return q_at
