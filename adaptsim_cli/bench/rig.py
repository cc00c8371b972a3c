"""The contracts of one bench: devices, person, tracker and planner of a trial. `devices` fulfils them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.bench.facts import RigFacts
from adaptsim_cli.config import is_simulated
from adaptsim_cli.screen.release import Release
from adaptsim_cli.screen.views import Readiness
from calib.types import HandEye
from hw.braking import slowed
from hw.ports import Arm, Camera, ObjectPlacer
from hw.types import Array, CameraModel, Execution, Frame, JointPath
from perception.types import ObjectTrack, Outcome
from sim.types import ToolMotion

Image = NDArray[np.uint8]


Paths = tuple[JointPath, JointPath, JointPath]
"""Approach from the home position, the motion itself, the way back."""


class Detection(Protocol):
    """The object, found before the motion."""

    @property
    def xy_m(self) -> Array:
        """(2,) the object's place on the table, in the base frame."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One recorded motion, with everything that tracking needs, for a new or an old trial."""

    before: Frame  # before the tool came: exactly the pixels in which the object was found
    frames: Sequence[Frame]  # colour as decoded from JPEG
    model: CameraModel
    X_BC: Array  # (4, 4)
    execution: Execution
    after: Frame | None = None  # with the arm at home again; None: it did not arrive, or nothing was carried


@dataclass(frozen=True)
class TrackRequest:
    """All inputs of tracking one trial."""

    recording: Recording
    detection: Any  # by `find`, before the motion
    X_BT_at: Callable[[float], Array]  # arm clock -> measured pose of the tool (4, 4)
    duration_s: float  # of the tool's motion


@dataclass(frozen=True)
class Tracker:
    """How the camera finds and tracks the object of one kind of task."""

    find: Callable[[Frame, CameraModel, Array], Detection]
    """(frame, model, X_BC) -> detection. Raises PerceptionError, also if the object is misplaced."""
    overlay: Callable[[Frame, CameraModel, Array, Any, Array], Image]
    """(frame, model, X_BC, detection, drawn context) -> (H, W, 3) RGB with the wanted place and the object found."""
    track: Callable[[TrackRequest], ObjectTrack]
    placement: Callable[[Array], Array]
    """Drawn context -> where the object has to be put, (2,) m in the base frame."""
    context: Callable[[Array, Any], Array]
    """(drawn context, detection) -> the context for the policy."""
    outcomes: tuple[Outcome, ...]
    """The outcomes that an operator may choose between."""
    at_home: Callable[[ObjectTrack, Any, Recording], ObjectTrack] = lambda track, *_: track
    """(track, detection, recording) -> the track. If a picture shows the arm at home, its outcome is the one seen
    there.

    For a task that carries its object."""
    lies_at_home: Callable[[ObjectTrack, Any, Recording], ObjectTrack | None] = lambda *_: None
    """The track with its outcome, for a trial that ended hidden. None if no picture shows the object."""


@dataclass(frozen=True)
class Planner:
    """From a tool motion to checked joint paths, and from joints to the flange."""

    paths: Callable[[ToolMotion], Paths]
    """Raises NotExecutable."""
    check: Callable[[JointPath], object]
    """Raises MotionRefused for a path that the arm would refuse."""
    flange: Callable[[Array], Array]
    """Reported joints (7,) -> the flange over the table, X_WF (4, 4)."""
    at_speed: Callable[[JointPath, float], JointPath] = slowed
    """(path, pace) -> the path as the arm plays it at that pace."""


class Attendant(Protocol):
    """The person beside a real arm, around its trials."""

    def recover(self) -> None:
        """Clear the arm's fault, if there is one and the person types so. Nothing moves."""

    def prepare(self, what: str) -> None:
        """Before `what` is placed: have the session confirmed, move home, and have the object weighed.

        Raises NotExecutable, MotionRefused, StoppedByOperator.
        """

    def facts(self) -> RigFacts:
        """The facts of the rig after a trial."""


@dataclass(frozen=True)
class Rig:
    """The connected devices of one bench."""

    name: str  # "fake", "panda", "fr3" or "fr3v2"
    title: str  # its name for an operator
    arm: Arm
    camera: Camera
    bench: ObjectPlacer
    hand_eye: HandEye
    calibration_days: int = 30  # an older calibration gives a warning
    attendant: Attendant | None = None  # None: nobody is needed
    wait: Callable[[float], None] = lambda _: None
    """(duration in s) -> None: wait. A simulated motion returns with the object at rest, so the lab does not wait."""
    await_enabled: Callable[[str, JointPath], None] = lambda what, path: None
    """Waits until the operator lets a motion begin, before any recording. `what` describes the motion, and the path is
    the one that is played. Raises StoppedByOperator, MotionRefused."""
    more_checks: tuple[Callable[[], Readiness], ...] = ()
    """Further checks before a session."""
    pace: float = 1.0  # of every motion; below 1 a trial is a rehearsal, which counts for nothing
    release: Release = field(default_factory=Release)  # the questions that let the arm move

    @property
    def is_real(self) -> bool:
        """Whether a real arm moves, which can hurt somebody."""
        return not is_simulated(self.name)
