"""A trial on a rig: place the object, find it, plan and check the motion, execute and record it, track the object."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from adaptsim_cli.bench.facts import RigFacts
from adaptsim_cli.bench.rig import Detection, Paths, Planner, Recording, Rig, Tracker, TrackRequest
from adaptsim_cli.errors import Interrupted
from adaptsim_cli.screen.release import Release
from adaptsim_cli.screen.views import Readiness, clear_to_move, top_speed_m_s
from adaptsim_cli.session import recording
from adaptsim_cli.session.film import Filmed, key_moments
from adaptsim_cli.session.folders import OVERLAY
from adaptsim_cli.session.live_trial import OutcomeUndecided, PlannedTrial, TrackedTrial
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.preflight import brightness, rig_checks
from adaptsim_cli.session.records import RIG, to_json
from adaptsim_cli.session.rig_preview import FoundObject, preview_of
from hw.braking import FULL
from hw.errors import ArmFault, HardwareError, MotionRefused, Rehearsed
from hw.poses import inverse
from hw.types import Array, Execution, Frame, JointPath
from perception.errors import ObjectNotFound
from perception.geometry import project
from perception.sightings import OutcomeUnseen
from perception.types import SETTLE_S, ObjectTrack, Outcome
from sim.adaptation.sessions import Progress, silently
from sim.adaptation.stages import RunTrial, TrialKey
from sim.errors import NotExecutable
from sim.tasks.hardware import Hardware
from sim.tasks.task import Task


@dataclass(frozen=True, eq=False, kw_only=True)
class RigPlan(PlannedTrial):
    """A planned trial with the three paths of the arm."""

    sighting: FoundObject
    paths: Paths


@dataclass(eq=False)
class RigMotion:
    """A `Motion` on a rig: recorded just now, or read from its file."""

    target: RigTarget
    context: Array  # (c,)
    action: Array  # (a,)
    stopped: HardwareError | None = None
    detection: Detection | None = None  # before the motion; None: it is found again in the recording
    followed: Future[ObjectTrack] | None = None  # the track, if it was begun beside the way back
    finish: Callable[[], tuple[Mapping[str, bytes], Recording]] | None = None  # None: it was read
    recorded: Recording | None = None  # None: not finished yet

    def files(self) -> Mapping[str, bytes]:
        """See `Motion`: recording, overlay, and the facts of a real rig."""
        assert self.finish is not None, "a motion that was read has its files"
        files, self.recorded = self.finish()
        return files

    def track(self, progress: Progress = silently) -> TrackedTrial:
        """See `Motion`."""
        assert self.recorded is not None, "the files of a motion come before its track"
        return self.target.track(self, self.recorded, progress)


@dataclass(frozen=True)
class RigTarget:
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
    def moves(self) -> bool:
        """Whether a real arm moves, which can hurt somebody."""
        return self.rig.is_real

    @property
    def release(self) -> Release:
        """See `Target`."""
        return self.rig.release

    @property
    def needs_consent(self) -> bool:
        """See `Target`: a real arm moves only if a person confirms it."""
        return self.rig.is_real

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes that a person may choose between."""
        return self.tracker.outcomes

    def executable(self, context: Array, action: Array) -> bool:
        """Whether the motion passes every limit of the arm; an `Executable` of solvers."""
        try:
            for path in self.planner.paths(self.hardware.plan(context, action)):
                self.planner.check(path)
        except (NotExecutable, MotionRefused):
            return False
        return True

    def checks(self) -> tuple[Readiness, ...]:
        """Check calibration, arm and camera; before that, an operator may clear a fault of the arm."""
        if self.rig.attendant is not None:
            self.rig.attendant.recover()
        return rig_checks(self.rig)

    def goes_on(self, key: TrialKey) -> bool:
        """See `Target`. It never does: an interrupted motion begins again."""
        return False

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """Ask the operator first, because the arm may have moved; on a real arm the attempt is spent."""
        operator.repeat_interrupted(stage)
        return self.moves

    def place(self, drawn: Array, key: TrialKey, operator: Operator, progress: Progress = silently) -> FoundObject:
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
            try:
                detection = tracker.find(frame, model, rig.hand_eye.X_BC)
            except ObjectNotFound as error:
                raise ObjectNotFound(str(error), _seen(frame)) from error
        context = tracker.context(drawn, detection)
        if not task.context.contains(context):
            ranges = ", ".join(f"{d.label} {d.low:g} to {d.high:g}" for d in task.context.dimensions)
            place = ", ".join(f"{value:.3f}" for value in context)
            message = f"the {task.object_name} lies outside of the area: found {place}; area {ranges}"
            raise ObjectNotFound(message, _seen(frame))
        overlay = tracker.overlay(frame, model, rig.hand_eye.X_BC, detection, drawn)
        return FoundObject(drawn, context, key, recording.encode_jpeg(overlay, 90), frame, detection)

    def plan(self, placed: FoundObject, action: Array, progress: Progress = silently) -> RigPlan:
        """The three paths of the motion, after they passed every limit."""
        with progress("Planning the motion", "planning"):
            paths = self.planner.paths(self.hardware.plan(placed.context, action))
        with progress("Checking every limit along the motion", "checking"):
            for path in paths:
                self.planner.check(path)
                self.planner.check(
                    self.planner.at_speed(path, self.rig.pace)
                )  # at full pace the same path, known by now
        pace, duration_s = self.rig.pace, sum(path.duration_s for path in paths)
        played = tuple(self.planner.at_speed(path, pace) for path in paths)
        played_s = sum(path.duration_s for path in played)
        slow = "" if pace == FULL else f", at pace {pace:g} {played_s:.1f} s: nothing is learnt from it"
        speed_m_s = top_speed_m_s(played, lambda q_rad: self.planner.flange(q_rad) @ self.hardware.X_FT)
        what, asked_s = f"comes to the {self.task.object_name}, makes its motion and goes back", played_s
        if self.release.asks_each:
            what, asked_s = f"comes to the {self.task.object_name}", played[0].duration_s
        return RigPlan(
            placed.drawn,
            placed.context,
            placed.key,
            action,
            summary=f"The motion takes {duration_s:.1f} s and passed all limits{slow}",
            announcement=clear_to_move(self.moves, what, asked_s, speed_m_s),
            overlay=placed.overlay,
            preview=preview_of(self.task, self.rig, self.tracker, self.planner, placed, paths),
            sighting=placed,
            paths=paths,
            digest=played[0].digest,
        )

    def execute(self, planned: RigPlan, progress: Progress = silently) -> RigMotion:
        """Approach, record the motion, go back.

        If the arm stops or loses its tool, the recording until then is kept. However it ends, no motion stays released.
        """
        try:
            return self._executed(planned, progress)
        finally:
            self.release.withdraw()

    def _executed(self, planned: RigPlan, progress: Progress) -> RigMotion:
        approach, motion, back = planned.paths
        arm, camera, after = self.rig.arm, self.rig.camera, None
        slow_approach, slow_motion, slow_back = (self.planner.at_speed(path, self.rig.pace) for path in planned.paths)
        stopped: HardwareError | None
        self.rig.await_enabled(f"comes to the {self.task.object_name}", slow_approach)
        with progress(f"The robot comes to the {self.task.object_name}", "moving"), _interruptible("on the way there"):
            arm.execute(approach)
        self.rig.await_enabled("makes its motion", slow_motion)
        with progress("The robot makes its motion and the camera records", "moving"):
            played, frames, stopped = self._film(motion)
        if stopped is None:
            self.release.completed()
        begun, followed = self._behind(planned, frames, played)
        del frames  # each is freed once it is compressed
        if stopped is None:
            try:
                self.rig.await_enabled("goes back", slow_back)
                with progress("The robot goes back", "moving"), _interruptible("on the way back"):
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
        finish = partial(self._finished, planned, begun, after)
        return RigMotion(self, planned.context, planned.action, stopped, planned.sighting.detection, followed, finish)

    def read(self, folder: Path, context: Array, action: Array) -> RigMotion:
        """See `Target`."""
        return RigMotion(self, context, action, recorded=recording.read(folder / recording.FILE))

    def track(self, rig_motion: RigMotion, stored: Recording, progress: Progress = silently) -> TrackedTrial:
        """Track the object from the detection before the motion. In a recording from a file, it is detected again in
        the same pixels.

        See `Motion.track`.
        """
        context, action = rig_motion.context, rig_motion.action
        motion, played = self.hardware.plan(context, action), stored.execution
        with progress(f"Tracking the {self.task.object_name} in {len(stored.frames)} frames", "tracking"):
            unseen, detection = None, rig_motion.detection
            if detection is None:
                detection = self.tracker.find(stored.before, stored.model, stored.X_BC)
            try:
                if rig_motion.followed is None:
                    track = self._follow(context, action, stored, detection)
                else:
                    track = rig_motion.followed.result()
                track = self.tracker.at_home(track, detection, stored)
            except OutcomeUnseen as error:
                if not error.followed:
                    raise
                at_home = self.tracker.lies_at_home(error.track, detection, stored)
                unseen, track = (error, error.track) if at_home is None else (None, at_home)
        with progress("Choosing the pictures of its key moments", "storing"):
            goal_m = None if self.task.goal_m is None else np.asarray(self.task.goal_m(context))
            found_m = np.asarray(detection.xy_m)
            filmed = Filmed(stored.frames, stored.model, stored.X_BC, played.t_start_s, track, found_m, goal_m)
            moments, images = filmed.moments(key_moments(motion.t_s[-1], motion.contact, float(track.t_s[-1])))
            film, sheet = filmed.sheet()
            path = recording.encode_object(track, played.t_start_s)
        tracked = TrackedTrial(
            track=track,
            track_px=project(stored.model.colour, inverse(stored.X_BC), track.state[:, :3]),
            moments=moments,
            film=film,
            files={recording.OBJECT_FILE: path, **images, **sheet},
            control_success_rate=played.control_success_rate,
        )
        if unseen is not None:
            raise OutcomeUndecided(str(unseen), tracked) from unseen
        return tracked

    def tool_pose(self, played: Execution) -> Callable[[float], Array]:
        """Arm clock -> tool pose in the base frame, from the measured joints; held beyond the ends."""
        flange, X_FT = self.planner.flange, self.hardware.X_FT
        return lambda t_s: flange(played.q_at(t_s)) @ X_FT

    def in_time(self, frame: Frame) -> Frame:
        """The frame with its time on the arm's clock: the camera delay found by the calibration is subtracted."""
        return replace(frame, t_s=frame.t_s - self.rig.hand_eye.camera_late_s)

    def _film(self, path: JointPath) -> tuple[Execution | None, Sequence[Frame], ArmFault | None]:
        """Play `path` and record it.

        The recording always ends, and an error while ending it never hides an earlier one.
        """
        rig, frames = self.rig, tuple[Frame, ...]()
        rig.camera.start_recording()
        try:
            with _interruptible("in mid-motion"):
                played = rig.arm.execute(path)
                rig.wait(SETTLE_S)
        except BaseException as error:
            with suppress(HardwareError):
                frames = tuple(rig.camera.stop_recording())
            if not isinstance(error, ArmFault):
                raise
            return None, frames, error
        return played, rig.camera.stop_recording(), None

    def _behind(
        self, planned: RigPlan, filmed: Sequence[Frame], played: Execution | None
    ) -> tuple[Future[recording.PartialRecording], Future[ObjectTrack] | None]:
        """While the arm goes back, compress and decode every frame, encode the recording, and track the object in it.

        `filmed` are on the camera's clock; those of the simulated lab may still be rendering. `played` is None if the
        arm stopped during the motion: then nothing is tracked.
        """
        X_BC, late_s = self.rig.hand_eye.X_BC, self.rig.hand_eye.camera_late_s
        model, arm = self.rig.camera.model(), self.rig.arm.model

        def encoded() -> recording.PartialRecording:
            first, *frames = [one.result() for one in compressed]
            moved = _motionless((*frames, first)[0].frame.t_s) if played is None else played
            return recording.begin(first, frames, model, X_BC, moved, self.tool_pose(moved), late_s, arm)

        def followed() -> ObjectTrack:
            return self._follow(planned.context, planned.action, begun.result().recording, planned.sighting.detection)

        pool = ThreadPoolExecutor(4, thread_name_prefix="behind")  # OpenCV and zstd release the interpreter
        compressed = [pool.submit(recording.stored, planned.sighting.frame, lossless=True)]
        one_by_one = [filmed[i : i + 1] for i in range(len(filmed))]
        compressed += [pool.submit(lambda one: recording.stored(self.in_time(one[0])), one) for one in one_by_one]
        begun = pool.submit(encoded)
        tracked = None if played is None else pool.submit(followed)
        pool.shutdown(wait=False)
        return begun, tracked

    def _follow(self, context: Array, action: Array, stored: Recording, detection: Detection) -> ObjectTrack:
        """Track the object through the frames of a recording."""
        duration_s = float(self.hardware.plan(context, action).t_s[-1])
        return self.tracker.track(TrackRequest(stored, detection, self.tool_pose(stored.execution), duration_s))

    def _finished(
        self, planned: RigPlan, begun: Future[recording.PartialRecording], after: Frame | None
    ) -> tuple[Mapping[str, bytes], Recording]:
        """(recording, overlay, and the facts of a real rig; the recording as it is tracked)."""
        mcap, stored = begun.result().finish(None if after is None else recording.stored(after, lossless=True))
        files, rig = {}, self.rig
        if rig.attendant is not None:
            facts = rig.attendant.facts().model_copy(update={"brightness": brightness(stored.before.colour)})
            try:
                files = {RIG: to_json(facts)}
            except ValueError as error:  # NaN must not cost the recording
                files = {RIG: to_json(RigFacts(problem=str(error)))}
        return {recording.FILE: mcap, OVERLAY: planned.sighting.overlay, **files}, stored


def _seen(frame: Frame) -> bytes:
    """The camera's picture, for the operator."""
    return recording.encode_jpeg(frame.colour, 90)


def _motionless(t_s: float) -> Execution:
    """A motion without samples: the arm stopped in it, and its joints are unknown."""
    return Execution(t_s, np.zeros(0), np.zeros((0, 7)), np.zeros((0, 7)), 0.0)


@contextmanager
def _interruptible(where: str) -> Iterator[None]:
    """Around a motion, which Ctrl-C brakes: raises Interrupted, which says where the arm stands."""
    try:
        yield
    except KeyboardInterrupt as error:
        raise Interrupted(
            f"interrupted {where}: the arm brakes and stays there. This trial does not count; everything completed "
            "is stored"
        ) from error
