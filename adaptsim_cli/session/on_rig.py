"""A trial on a rig: place the object, find it, plan and check the motion, execute and record it, track the object."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.screen.checks import Readiness
from adaptsim_cli.screen.clear import clear_to_move, top_speed_m_s
from adaptsim_cli.session import moments, recording
from adaptsim_cli.session.drift import brightness
from adaptsim_cli.session.during import During, silently
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.preflight import rig_checks
from adaptsim_cli.session.records import RIG, RigFacts, to_json
from adaptsim_cli.session.rig import Paths, Planner, Rig, Tracker, TrackRequest
from adaptsim_cli.session.stages import RunTrial, TrialKey
from adaptsim_cli.session.target import TrialEvidence
from adaptsim_cli.session.watching import Sight
from hw.errors import ArmFault, HardwareError, Rehearsed
from hw.kinematics import FLANGE, link_poses
from hw.pacing import FULL, slowed
from hw.poses import inverse
from hw.types import Array, Execution, Frame, JointPath
from perception.errors import ObjectNotFound
from perception.geometry import project
from perception.types import SETTLE_S, ObjectTrack, Outcome
from sim.tasks.task import Hardware, Task
from sim.types import ToolMotion


@dataclass(frozen=True)
class OnRig:
    """A `Target`: a bench with an arm and a camera, real or of the simulated lab."""

    task: Task
    rig: Rig
    tracker: Tracker
    planner: Planner

    @property
    def hardware(self) -> Hardware:
        """The task's parts for an arm."""
        return self.task.require_hardware()

    @property
    def title(self) -> str:
        """The lab's name on the screen."""
        return self.rig.title

    @property
    def is_real(self) -> bool:
        """Whether a real arm moves, which can hurt somebody."""
        return self.rig.is_real

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes that a person may choose between."""
        return self.tracker.outcomes

    def checks(self) -> tuple[Readiness, ...]:
        """Check calibration, arm and camera; before that, an operator may clear a fault of the arm."""
        if self.rig.attendant is not None:
            self.rig.attendant.recover()
        return rig_checks(self.rig)

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """Ask the operator first, because the arm may have moved; on a real arm the attempt is spent."""
        operator.repeat_interrupted(stage)
        return self.is_real

    def set_up(self, drawn: Array, key: TrialKey, operator: Operator, during: During = silently) -> RigReady:
        """Have the object placed, find it with the camera, and check that it lies in the area."""
        task, rig, tracker = self.task, self.rig, self.tracker
        if rig.attendant is not None:
            rig.attendant.prepare(task.object_name)
        wanted_m = tracker.placement(drawn)
        operator.placed(task.object_name, wanted_m, rig.is_real)
        with during(f"Placing the {task.object_name}", "placing"):
            rig.bench.place(wanted_m, key.number, key.attempt)
        with during("Taking a picture", "finding"):
            frame, model = self.in_time(rig.camera.snapshot()), rig.camera.model()
        with during(f"Finding the {task.object_name}", "finding"):
            detection = tracker.find(frame, model, rig.hand_eye.X_BC)
        context = tracker.context(drawn, detection)
        if not task.context.contains(context):
            ranges = ", ".join(f"{d.label} {d.low:g} to {d.high:g}" for d in task.context.dimensions)
            found = ", ".join(f"{value:.3f}" for value in context)
            raise ObjectNotFound(f"the {task.object_name} lies outside of the area: found {found}; area {ranges}")
        overlay = tracker.overlay(frame, model, rig.hand_eye.X_BC, detection, drawn)
        return RigReady(self, drawn, context, frame, detection, recording.encode_jpeg(overlay, 90))

    def replay(self, context: Array, action: Array, folder: Path) -> RigReplay:
        """Read the recording, and find the object again in the same pixels as before the motion."""
        stored = recording.read(folder / recording.FILE)
        detection = self.tracker.find(stored.before, stored.model, stored.X_BC)
        return RigReplay(self, stored, self.hardware.plan(context, action), detection)

    def tool_pose(self, played: Execution) -> Callable[[float], Array]:
        """Arm clock -> tool pose in the base frame, from the measured joints; held beyond the ends."""
        q_at, flange, X_FT = joints(played), self.planner.flange, self.hardware.X_FT
        return lambda t_s: flange(q_at(t_s)) @ X_FT

    def in_time(self, frame: Frame) -> Frame:
        """The frame with its time on the arm's clock: the camera delay found by the calibration is subtracted."""
        return replace(frame, t_s=frame.t_s - self.rig.hand_eye.camera_late_s)


@dataclass(frozen=True, eq=False)
class RigReady:
    """The object lies in the area, and the camera has found it."""

    target: OnRig
    drawn: Array  # (c,) the wanted context
    context: Array  # (c,) as measured
    frame: Frame  # the object was found in it
    detection: Any
    overlay: bytes  # JPEG with the detection drawn

    def plan(self, action: Array, during: During = silently) -> RigPlan:
        """The three paths of the motion, after they passed every limit."""
        planner = self.target.planner
        with during("Planning the motion", "planning"):
            paths = planner.paths(self.target.hardware.plan(self.context, action))
        with during("Checking every limit along the motion", "checking"):
            for path in paths:
                planner.check(path)
                planner.check(slowed(path, self.target.rig.pace))
        return RigPlan(self, paths)


@dataclass(frozen=True, eq=False)
class RigPlan:
    """A motion that passed every limit."""

    found: RigReady
    paths: Paths  # approach, motion, way back

    @property
    def duration_s(self) -> float:
        """Duration of all three paths together, s."""
        return sum(path.duration_s for path in self.paths)

    @property
    def summary(self) -> str:
        """How long the motion takes, for the screen."""
        pace = self.found.target.rig.pace
        slow = "" if pace == FULL else f", at pace {pace:g} {self.duration_s / pace:.1f} s: nothing is learnt from it"
        return f"The motion takes {self.duration_s:.1f} s and passed all limits{slow}"

    @property
    def announcement(self) -> str:
        """The sentence that asks for approval: what moves, and how fast."""
        target = self.found.target
        flange, X_FT = target.planner.flange, target.hardware.X_FT
        speed_m_s = top_speed_m_s(self.paths, lambda q_rad: flange(q_rad) @ X_FT)
        what = f"comes to the {target.task.object_name}, makes its motion and goes back"
        pace = target.rig.pace
        return clear_to_move(target.is_real, what, self.duration_s / pace, speed_m_s * pace)

    def sight(self) -> Sight:
        """The picture with the path of the tool, and the arm along all three paths."""
        found, target = self.found, self.found.target
        model, context = target.rig.camera.model(), target.task.context
        X_CB = inverse(target.rig.hand_eye.X_BC)
        begun_s = self.paths[0].duration_s
        motion_s = (begun_s, begun_s + self.paths[1].duration_s)
        t_s, q_rad = _decimated(self.paths)
        X_BF = np.array([target.planner.flange(q) for q in q_rad])
        tool_m = (X_BF @ target.hardware.X_FT)[:, :3, 3]
        joints_m = link_poses(q_rad)[:, :FLANGE, :3, 3]
        path_m = tool_m[(t_s >= motion_s[0]) & (t_s <= motion_s[1])]
        corners = np.array([target.tracker.placement(corner) for corner in (context.low, context.high)])[:, :2]
        low, high = corners.min(axis=0), corners.max(axis=0)
        return Sight(
            picture=found.overlay,
            size_px=(model.colour.width, model.colour.height),
            path_px=project(model.colour, X_CB, path_m),
            path_m=path_m,
            t_s=t_s,
            arm_m=np.concatenate([joints_m, X_BF[:, None, :3, 3], tool_m[:, None]], axis=1),
            motion_s=motion_s,
            spot_m=np.asarray(found.detection.xy_m),
            area_m=np.array([low[0], high[0], low[1], high[1]]),
            goal_m=None if target.task.goal_m is None else np.asarray(target.task.goal_m(found.context)),
        )

    def execute(self, during: During = silently) -> RigTrial:
        """Approach, record the motion, go back.

        If the arm stops or loses its tool, the recording until then is kept.
        """
        approach, motion, back = self.paths
        target, after = self.found.target, None
        stopped: HardwareError | None
        arm = target.rig.arm
        with during(f"The robot comes to the {target.task.object_name}", "moving"):
            arm.execute(approach)
        with during("The robot makes its motion and the camera records", "moving"):
            played, frames, stopped = self._film(motion)
        if stopped is None:
            try:
                with during("The robot goes back", "moving"):
                    arm.execute(back)
                if target.hardware.carries:
                    with during("Taking a picture of the table", "finding"):
                        after = target.in_time(target.rig.camera.snapshot())
            except HardwareError as fault:
                stopped = fault
        if stopped is None and target.rig.pace < FULL:
            stopped = Rehearsed(
                f"played at pace {target.rig.pace:g} to its end, as a rehearsal: nothing is learnt from it. The same "
                "command without --pace makes the trial"
            )
        return RigTrial(self.found, played, frames, stopped, after)

    def _film(self, path: JointPath) -> tuple[Execution | None, Sequence[Frame], ArmFault | None]:
        """Play `path` and record it.

        The recording always ends, and an error while ending it never hides an earlier one.
        """
        rig, frames = self.found.target.rig, tuple[Frame, ...]()
        rig.await_enabled()
        rig.camera.start_recording()
        try:
            played = rig.arm.execute(path)
            rig.wait(SETTLE_S)
        except BaseException as error:
            with suppress(HardwareError):
                frames = tuple(rig.camera.stop_recording())
            if not isinstance(error, ArmFault):
                raise
            return None, frames, error
        return played, rig.camera.stop_recording(), None


@dataclass(frozen=True, eq=False)
class RigTrial:
    """The data of one motion from arm and camera."""

    found: RigReady
    played: Execution | None  # None: the arm stopped during the motion
    frames: Sequence[Frame]  # on the camera's clock; those of the simulated lab may still be rendering
    stopped: HardwareError | None
    after: Frame | None  # with the arm at home again; only for a task that carries its object

    def files(self) -> Mapping[str, bytes]:
        """Recording, overlay, and the facts of a real rig."""
        target, before = self.found.target, self.found.frame
        rig, played, frames = target.rig, self.played, tuple(map(target.in_time, self.frames))
        if played is None:
            none = np.zeros((0, 7))
            played = Execution(frames[0].t_s if frames else before.t_s, np.zeros(0), none, none, 0.0)
        eye = rig.hand_eye
        mcap = recording.encode(
            before,
            frames,
            rig.camera.model(),
            eye.X_BC,
            played,
            target.tool_pose(played),
            eye.camera_late_s,
            self.after,
            rig.arm.model,
        )
        said = {}
        if rig.attendant is not None:
            facts = rig.attendant.facts().model_copy(update={"brightness": brightness(before.colour)})
            try:
                said = {RIG: to_json(facts)}
            except ValueError as error:  # a number that is none must not cost the recording
                said = {RIG: to_json(RigFacts(problem=str(error)))}
        return {recording.FILE: mcap, "overlay.jpg": self.found.overlay, **said}


@dataclass(frozen=True, eq=False)
class RigReplay:
    """A recorded motion, with the object as it lay before the motion."""

    target: OnRig
    stored: recording.Recording
    motion: ToolMotion
    detection: Any

    @property
    def looking(self) -> str:
        """The sentence on the screen while the object is tracked."""
        return f"Tracking the {self.target.task.object_name} in {len(self.stored.frames)} frames"

    def track(self) -> ObjectTrack:
        """Track the object in the recorded frames. Raises PerceptionError."""
        stored, played = self.stored, self.stored.execution
        return self.target.tracker.track(
            TrackRequest(
                frames=stored.frames,
                model=stored.model,
                X_BC=stored.X_BC,
                detection=self.detection,
                X_BT_at=self.target.tool_pose(played),
                q_at=joints(played),
                t_start_s=played.t_start_s,
                duration_s=float(self.motion.t_s[-1]),
                at_home=stored.at_home,
            )
        )

    def evidence(self, track: ObjectTrack) -> TrialEvidence:
        """The frames of the key moments, and the track for a viewer."""
        stored, motion, played = self.stored, self.motion, self.stored.execution
        wanted = moments.moments(motion.t_s[-1], motion.contact, float(track.t_s[-1]))
        seen_m = np.array([[*self.detection.xy_m, 0.0], *track.state[:, :3]])
        fallen = track.outcome is Outcome.TIPPED
        kept, images = moments.key_frames(
            stored.frames, stored.model, stored.X_BC, seen_m, played.t_start_s, wanted, fallen=fallen, track=track
        )
        path = recording.encode_object(track, played.t_start_s)
        return TrialEvidence({recording.OBJECT_FILE: path, **images}, kept, played.control_success_rate)

    def track_px(self, track: ObjectTrack) -> Array:
        """See `TrialReplay`."""
        return project(self.stored.model.colour, inverse(self.stored.X_BC), track.state[:, :3])


_SHOWN = 120
"""Postures of the arm that a page draws, over all three paths."""


def _decimated(paths: Paths) -> tuple[Array, Array]:
    """Times (K,) from the start of the first path, and joints (K, 7), of at most `_SHOWN` postures."""
    starts_s = np.cumsum([0.0, *(path.duration_s for path in paths)])
    t_s = np.concatenate([start + path.t_s for start, path in zip(starts_s, paths, strict=False)])
    q_rad = np.concatenate([path.q_rad for path in paths])
    kept = np.unique(np.linspace(0, len(t_s) - 1, min(_SHOWN, len(t_s))).round().astype(int))
    return t_s[kept], q_rad[kept]


def joints(played: Execution) -> Callable[[float], Array]:
    """Arm clock -> measured joints (7,), held beyond the ends."""

    def q_at(t_s: float) -> Array:
        since_s = t_s - played.t_start_s
        return np.array([np.interp(since_s, played.t_s, joint) for joint in played.q_measured_rad.T])

    return q_at
