"""A trial on a rig: place the object, find it, plan and check the motion, execute and record it, track the object."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from adaptsim_cli.screen.views import Readiness, clear_to_move, top_speed_m_s
from adaptsim_cli.session import recording
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.preflight import brightness, rig_checks
from adaptsim_cli.session.recording import encode_jpeg
from adaptsim_cli.session.records import RIG, KeyMoment, RigFacts, RunTrial, TrialKey, to_json
from adaptsim_cli.session.target import (
    Executed,
    Image,
    MotionPreview,
    Paths,
    Placed,
    Planned,
    Planner,
    Progress,
    Rig,
    TrackedTrial,
    Tracker,
    TrackRequest,
    silently,
)
from hw.errors import ArmFault, HardwareError, Rehearsed
from hw.kinematics import FLANGE, link_poses
from hw.pacing import FULL, slowed
from hw.poses import inverse
from hw.types import Array, CameraModel, ContactWindow, Execution, Frame, JointPath
from perception.errors import ObjectNotFound
from perception.geometry import project
from perception.types import SETTLE_S, ObjectTrack, Outcome
from sim.tasks.task import Hardware, Task

_HEIGHT_PX = 480
_ASPECT = 1.0
_REACH_M, _FALLEN_REACH_M = 0.08, 0.20  # margin shown around the object's path; larger for a fallen one, which rolls
_REST_S = 0.15  # an object tracked this much longer than the motion came to rest elsewhere
_QUALITY = 85
_RING_PX = 11


def key_moments(duration_s: float, contact: ContactWindow | None, last_s: float) -> tuple[tuple[str, float], ...]:
    """(label, seconds since the start of the motion), in order; the object is tracked until `last_s`."""
    rest = (("rest", last_s),) if last_s > duration_s + _REST_S else ()
    if contact is None:
        return (("start", 0.0), ("middle", duration_s / 2), ("end", duration_s), *rest)
    touching_s = (contact.start_s + contact.end_s) / 2  # the first touch is often the start itself
    return (("start", 0.0), ("contact", touching_s), ("lift", contact.end_s), ("end", duration_s), *rest)


def key_frames(
    frames: Sequence[Frame],
    model: CameraModel,
    X_BC: Array,
    seen_m: Array,
    t_start_s: float,
    wanted: Sequence[tuple[str, float]],
    *,
    fallen: bool = False,
    track: ObjectTrack | None = None,
) -> tuple[tuple[KeyMoment, ...], dict[str, bytes]]:
    """The frames nearest to the `wanted` moments, cut around the points `seen_m` (N, 3) -> (records, name -> JPEG).

    An object that has `fallen` gets a wider cut, because it rolls. A ring marks the centre of the `track` at that time,
    a line its path until then.
    """
    if not frames:
        return (), {}
    times_s = np.array([frame.t_s for frame in frames]) - t_start_s
    window = _window(model, X_BC, seen_m, _FALLEN_REACH_M if fallen else _REACH_M)
    kept, files = [], {}
    for label, t_s in wanted:
        index = int(np.abs(times_s - t_s).argmin())
        name = f"moment-{label}.jpg"
        picture = _cut(frames[index].colour, window)
        if track is not None:
            _mark(picture, _way_px(model, X_BC, track, float(times_s[index])), window)
        files[name] = encode_jpeg(picture, _QUALITY)
        kept.append(KeyMoment(label=label, t_s=float(times_s[index]), file=name))
    return tuple(kept), files


def _window(model: CameraModel, X_BC: Array, seen_m: Array, reach_m: float) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) in pixels of the colour image, inside it, with aspect _ASPECT."""
    colour = model.colour
    low_m, high_m = seen_m.min(axis=0) - reach_m, seen_m.max(axis=0) + reach_m
    top_m = seen_m[:, 2].max() + seen_m[1:, 2].min()  # the highest centre and half the object's own height
    corners = np.array([[x, y, z] for x in (low_m[0], high_m[0]) for y in (low_m[1], high_m[1]) for z in (0.0, top_m)])
    pixels = _pixels(model, X_BC, corners)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    middle = (low + high) / 2
    height = min(max(high[1] - low[1], (high[0] - low[0]) / _ASPECT), colour.height, colour.width / _ASPECT)
    half = np.array([height * _ASPECT, height]) / 2
    limit = np.array([colour.width, colour.height])
    middle = np.clip(middle, half, limit - half)
    left, top = np.floor(middle - half).astype(int)
    right, bottom = np.ceil(middle + half).astype(int)
    return max(left, 0), max(top, 0), min(right, colour.width), min(bottom, colour.height)


def _pixels(model: CameraModel, X_BC: Array, p_m: Array) -> Array:
    """(N, 3) in the base frame -> (N, 2) in the colour image."""
    X_CB, colour = np.linalg.inv(X_BC), model.colour
    pixels, _ = cv2.projectPoints(
        p_m @ X_CB[:3, :3].T + X_CB[:3, 3], np.zeros(3), np.zeros(3), colour.K, colour.distortion
    )
    return np.asarray(pixels.reshape(-1, 2), np.float64)


def _way_px(model: CameraModel, X_BC: Array, track: ObjectTrack, until_s: float) -> Array:
    """(N, 2) the centre in the colour image at every tracked time up to `until_s`, and at that time."""
    before = track.state[track.t_s < until_s, :3]
    return _pixels(model, X_BC, np.concatenate([before, track.at(np.array([until_s]))[:, :3]]))


def _mark(picture: Image, way_px: Array, window: tuple[int, int, int, int]) -> None:
    """Draw the path of the centre, and a ring around its end, into a cut picture."""
    left, top, right, bottom = window
    scale = np.array([picture.shape[1] / (right - left), picture.shape[0] / (bottom - top)])
    shift = 4  # OpenCV draws in sixteenths of a pixel
    points = np.round((way_px - [left, top]) * scale * 2**shift).astype(np.int32)
    for colour, width in (((20, 20, 20), 4), ((255, 190, 40), 2)):
        cv2.polylines(picture, [points.reshape(-1, 1, 2)], False, colour, width - 1, cv2.LINE_AA, shift)
        centre = (int(points[-1, 0]), int(points[-1, 1]))
        cv2.circle(picture, centre, _RING_PX << shift, colour, width, cv2.LINE_AA, shift)


def _cut(image: Image, window: tuple[int, int, int, int]) -> Image:
    left, top, right, bottom = window
    size = (round(_HEIGHT_PX * _ASPECT), _HEIGHT_PX)
    return np.array(cv2.resize(image[top:bottom, left:right], size, interpolation=cv2.INTER_AREA), np.uint8)


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

    def place(self, drawn: Array, key: TrialKey, operator: Operator, progress: Progress = silently) -> Placed:
        """Have the object placed, find it with the camera, and check that it lies in the area."""
        task, rig, tracker = self.task, self.rig, self.tracker
        if rig.attendant is not None:
            rig.attendant.prepare(task.object_name)
        wanted_m = tracker.placement(drawn)
        operator.placed(task.object_name, wanted_m, rig.is_real)
        with progress(f"Placing the {task.object_name}", "placing"):
            rig.bench.place(wanted_m, key.number, key.attempt)
        with progress("Taking a picture", "finding"):
            frame, model = self.in_time(rig.camera.snapshot()), rig.camera.model()
        with progress(f"Finding the {task.object_name}", "finding"):
            detection = tracker.find(frame, model, rig.hand_eye.X_BC)
        context = tracker.context(drawn, detection)
        if not task.context.contains(context):
            ranges = ", ".join(f"{d.label} {d.low:g} to {d.high:g}" for d in task.context.dimensions)
            found = ", ".join(f"{value:.3f}" for value in context)
            raise ObjectNotFound(f"the {task.object_name} lies outside of the area: found {found}; area {ranges}")
        overlay = tracker.overlay(frame, model, rig.hand_eye.X_BC, detection, drawn)
        return Placed(drawn, context, recording.encode_jpeg(overlay, 90), frame, detection)

    def plan(self, placed: Placed, action: Array, progress: Progress = silently) -> Planned:
        """The three paths of the motion, after they passed every limit."""
        with progress("Planning the motion", "planning"):
            paths = self.planner.paths(self.hardware.plan(placed.context, action))
        with progress("Checking every limit along the motion", "checking"):
            for path in paths:
                self.planner.check(path)
                self.planner.check(slowed(path, self.rig.pace))
        pace, duration_s = self.rig.pace, sum(path.duration_s for path in paths)
        slow = "" if pace == FULL else f", at pace {pace:g} {duration_s / pace:.1f} s: nothing is learnt from it"
        speed_m_s = top_speed_m_s(paths, lambda q_rad: self.planner.flange(q_rad) @ self.hardware.X_FT)
        what = f"comes to the {self.task.object_name}, makes its motion and goes back"
        return Planned(
            placed=placed,
            action=action,
            summary=f"The motion takes {duration_s:.1f} s and passed all limits{slow}",
            announcement=clear_to_move(self.is_real, what, duration_s / pace, speed_m_s * pace),
            preview=self._preview(placed, paths),
            paths=paths,
        )

    def execute(self, planned: Planned, progress: Progress = silently) -> Executed:
        """Approach, record the motion, go back.

        If the arm stops or loses its tool, the recording until then is kept.
        """
        assert planned.paths is not None and planned.placed.frame is not None
        approach, motion, back = planned.paths
        arm, camera, after = self.rig.arm, self.rig.camera, None
        stopped: HardwareError | None
        with progress(f"The robot comes to the {self.task.object_name}", "moving"):
            arm.execute(approach)
        with progress("The robot makes its motion and the camera records", "moving"):
            played, frames, stopped = self._film(motion)
        if stopped is None:
            try:
                with progress("The robot goes back", "moving"):
                    arm.execute(back)
                if self.hardware.carries:
                    with progress("Taking a picture of the table", "finding"):
                        after = self.in_time(camera.snapshot())
            except HardwareError as fault:
                stopped = fault
        if stopped is None and self.rig.pace < FULL:
            stopped = Rehearsed(
                f"played at pace {self.rig.pace:g} to its end, as a rehearsal: nothing is learnt from it. The same "
                "command without --pace makes the trial"
            )
        return Executed(partial(self._files, planned.placed, planned.placed.frame, played, frames, after), stopped)

    def track(self, context: Array, action: Array, folder: Path, progress: Progress = silently) -> TrackedTrial:
        """Read the recording, find the object again in the same pixels as before the motion, and track it."""
        with progress("Reading the recording", "reading"):
            stored = recording.read(folder / recording.FILE)
            detection = self.tracker.find(stored.before, stored.model, stored.X_BC)
        motion, played, name = self.hardware.plan(context, action), stored.execution, self.task.object_name
        request = TrackRequest(
            frames=stored.frames,
            model=stored.model,
            X_BC=stored.X_BC,
            detection=detection,
            X_BT_at=self.tool_pose(played),
            q_at=joints(played),
            t_start_s=played.t_start_s,
            duration_s=float(motion.t_s[-1]),
            at_home=stored.at_home,
        )
        with progress(f"Tracking the {name} in {len(stored.frames)} frames", "tracking"):
            track = self.tracker.track(request)
        with progress("Choosing the pictures of its key moments", "storing"):
            wanted = key_moments(motion.t_s[-1], motion.contact, float(track.t_s[-1]))
            seen_m = np.array([[*detection.xy_m, 0.0], *track.state[:, :3]])
            kept, images = key_frames(
                stored.frames,
                stored.model,
                stored.X_BC,
                seen_m,
                played.t_start_s,
                wanted,
                fallen=track.outcome is Outcome.TIPPED,
                track=track,
            )
            path = recording.encode_object(track, played.t_start_s)
        return TrackedTrial(
            track=track,
            track_px=project(stored.model.colour, inverse(stored.X_BC), track.state[:, :3]),
            moments=kept,
            files={recording.OBJECT_FILE: path, **images},
            control_success_rate=played.control_success_rate,
        )

    def tool_pose(self, played: Execution) -> Callable[[float], Array]:
        """Arm clock -> tool pose in the base frame, from the measured joints; held beyond the ends."""
        q_at, flange, X_FT = joints(played), self.planner.flange, self.hardware.X_FT
        return lambda t_s: flange(q_at(t_s)) @ X_FT

    def in_time(self, frame: Frame) -> Frame:
        """The frame with its time on the arm's clock: the camera delay found by the calibration is subtracted."""
        return replace(frame, t_s=frame.t_s - self.rig.hand_eye.camera_late_s)

    def _preview(self, placed: Placed, paths: Paths) -> MotionPreview:
        """The picture with the path of the tool, and the arm along all three paths."""
        model, context = self.rig.camera.model(), self.task.context
        X_CB = inverse(self.rig.hand_eye.X_BC)
        begun_s = paths[0].duration_s
        motion_s = (begun_s, begun_s + paths[1].duration_s)
        t_s, q_rad = _decimated(paths)
        X_BF = np.array([self.planner.flange(q) for q in q_rad])
        tool_m = (X_BF @ self.hardware.X_FT)[:, :3, 3]
        joints_m = link_poses(q_rad)[:, :FLANGE, :3, 3]
        path_m = tool_m[(t_s >= motion_s[0]) & (t_s <= motion_s[1])]
        corners = np.array([self.tracker.placement(corner) for corner in (context.low, context.high)])[:, :2]
        low, high = corners.min(axis=0), corners.max(axis=0)
        return MotionPreview(
            picture=placed.overlay or b"",
            size_px=(model.colour.width, model.colour.height),
            path_px=project(model.colour, X_CB, path_m),
            path_m=path_m,
            t_s=t_s,
            arm_m=np.concatenate([joints_m, X_BF[:, None, :3, 3], tool_m[:, None]], axis=1),
            motion_s=motion_s,
            spot_m=np.asarray(placed.detection.xy_m),
            area_m=np.array([low[0], high[0], low[1], high[1]]),
            goal_m=None if self.task.goal_m is None else np.asarray(self.task.goal_m(placed.context)),
        )

    def _film(self, path: JointPath) -> tuple[Execution | None, Sequence[Frame], ArmFault | None]:
        """Play `path` and record it.

        The recording always ends, and an error while ending it never hides an earlier one.
        """
        rig, frames = self.rig, tuple[Frame, ...]()
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

    def _files(
        self, placed: Placed, before: Frame, played: Execution | None, filmed: Sequence[Frame], after: Frame | None
    ) -> Mapping[str, bytes]:
        """Recording, overlay, and the facts of a real rig. `played` is None if the arm stopped during the motion.

        `filmed` are on the camera's clock; those of the simulated lab may still be rendering.
        """
        rig, frames = self.rig, tuple(map(self.in_time, filmed))
        if played is None:
            none = np.zeros((0, 7))
            played = Execution(frames[0].t_s if frames else before.t_s, np.zeros(0), none, none, 0.0)
        mcap = recording.encode(
            before,
            frames,
            rig.camera.model(),
            rig.hand_eye.X_BC,
            played,
            self.tool_pose(played),
            rig.hand_eye.camera_late_s,
            after,
            rig.arm.model,
        )
        said = {}
        if rig.attendant is not None:
            facts = rig.attendant.facts().model_copy(update={"brightness": brightness(before.colour)})
            try:
                said = {RIG: to_json(facts)}
            except ValueError as error:  # a number that is none must not cost the recording
                said = {RIG: to_json(RigFacts(problem=str(error)))}
        return {recording.FILE: mcap, "overlay.jpg": placed.overlay or b"", **said}


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
