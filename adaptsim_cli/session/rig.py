"""The interface between a session and its devices, tracker and planner; `wiring` provides them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.config import is_simulated
from adaptsim_cli.screen.checks import Readiness
from adaptsim_cli.session.records import RigFacts
from calib.types import HandEye
from hw.ports import Arm, Bench, Camera
from hw.types import Array, CameraModel, Frame, JointPath
from perception.types import ObjectTrack, Outcome
from sim.types import ToolMotion

Image = NDArray[np.uint8]


class Detection(Protocol):
    """The object, found before the motion."""

    @property
    def xy_m(self) -> Array:
        """(2,) the object's place on the table, in the base frame."""
        ...


@dataclass(frozen=True)
class TrackRequest:
    """All inputs of tracking one trial."""

    frames: Sequence[Frame]
    model: CameraModel
    X_BC: Array  # (4, 4)
    detection: Any  # by `find`, before the motion
    X_BT_at: Callable[[float], Array]  # arm clock -> measured pose of the tool (4, 4)
    q_at: Callable[[float], Array]  # arm clock -> measured joints (7,), held beyond the ends
    t_start_s: float  # arm clock at the start of the tool's motion
    duration_s: float  # of the tool's motion
    at_home: tuple[Frame, Frame] | None = None  # before and after; only for a task that carries its object


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


Paths = tuple[JointPath, JointPath, JointPath]


@dataclass(frozen=True)
class Planner:
    """From a tool motion to checked joint paths, and from joints to the flange."""

    paths: Callable[[ToolMotion], Paths]
    """Approach from the home position, the motion itself, the way back. Raises NotExecutable."""
    check: Callable[[JointPath], object]
    """Raises MotionRefused for a path that the arm would refuse."""
    flange: Callable[[Array], Array]
    """Reported joints (7,) -> the flange over the table, X_WF (4, 4)."""


class Attendant(Protocol):
    """The person beside a real arm, around its trials."""

    def recover(self) -> None:
        """Clear the arm's fault, if there is one and the person types so. Nothing moves."""
        ...

    def prepare(self, what: str) -> None:
        """Before `what` is placed: the confirmation, the way home, the weighing.

        Raises NotExecutable, MotionRefused, StoppedByOperator.
        """
        ...

    def facts(self) -> RigFacts:
        """The facts of the rig after a trial."""
        ...


@dataclass(frozen=True)
class Rig:
    """The connected devices of one bench."""

    name: str  # "fake", "panda" or "fr3"
    title: str  # its name for an operator
    arm: Arm
    camera: Camera
    bench: Bench
    hand_eye: HandEye
    calibration_days: int = 30  # an older calibration gives a warning
    attendant: Attendant | None = None  # None: nobody is needed
    wait: Callable[[float], None] = lambda _: None
    """(duration in s) -> None: wait. A simulated motion returns with the object at rest, so the lab does not wait."""
    await_enabled: Callable[[], None] = lambda: None
    """Waits until the operator enables motion, so that no recording runs meanwhile. Raises MotionRefused."""
    more_checks: tuple[Callable[[], Readiness], ...] = ()
    """Further checks before a session."""
    pace: float = 1.0  # of every motion; below 1 a trial is a rehearsal, which counts for nothing

    @property
    def is_real(self) -> bool:
        """Whether a real arm moves, which can hurt somebody."""
        return not is_simulated(self.name)
