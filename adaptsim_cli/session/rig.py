"""What the sequence of a session asks of devices, tracking and planning; `wiring` fills it in."""

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
    """The object lying ready."""

    @property
    def xy_m(self) -> Array:
        """(2,) of the object on the table, in the base frame."""
        ...


@dataclass(frozen=True)
class TrackRequest:
    """All that tracking gets to see of one trial."""

    frames: Sequence[Frame]
    model: CameraModel
    X_BC: Array  # (4, 4)
    detection: Any  # what `find` returned before the motion
    X_BT_at: Callable[[float], Array]  # arm clock -> measured pose of the tool (4, 4)
    q_at: Callable[[float], Array]  # arm clock -> measured joints (7,), held beyond the ends
    t_start_s: float  # arm clock at the start of the tool's motion
    duration_s: float  # of the tool's motion
    at_home: tuple[Frame, Frame] | None = None  # before and after, of a task that carries its object


@dataclass(frozen=True)
class Tracker:
    """How the camera sees the object of one kind of task."""

    find: Callable[[Frame, CameraModel, Array], Detection]
    """(frame, model, X_BC) -> detection. Raises PerceptionError, also where it is misplaced."""
    overlay: Callable[[Frame, CameraModel, Array, Any, Array], Image]
    """(frame, model, X_BC, detection, drawn context) -> (H, W, 3) RGB with what was asked for and what was found."""
    track: Callable[[TrackRequest], ObjectTrack]
    placement: Callable[[Array], Array]
    """Drawn context -> where the object has to be put, (2,) m in the base frame."""
    context: Callable[[Array, Any], Array]
    """(drawn context, detection) -> the context that the policy is given."""
    outcomes: tuple[Outcome, ...]
    """How a trial can end, for an operator who saw it otherwise."""


Paths = tuple[JointPath, JointPath, JointPath]


@dataclass(frozen=True)
class Planner:
    """From a tool motion to checked joint paths, and from joints to the flange."""

    paths: Callable[[ToolMotion], Paths]
    """Approach from the home position, the motion itself, the way back. Raises NotExecutable."""
    check: Callable[[JointPath], object]
    """Raises MotionRefused for what the arm would refuse."""
    flange: Callable[[Array], Array]
    """Joints (7,) as the arm reports them -> its flange over the table, X_WF (4, 4)."""


class Attendant(Protocol):
    """The person beside a real arm, around its trials."""

    def recover(self) -> None:
        """Clear the arm's fault, if it has one, where the person says so. Nothing moves."""
        ...

    def prepare(self, what: str) -> None:
        """Before `what` is placed: the confirmation, the way home, the weighing.

        Raises NotExecutable, MotionRefused, StoppedByOperator.
        """
        ...

    def facts(self) -> RigFacts:
        """What the rig says of itself after a trial."""
        ...


@dataclass(frozen=True)
class Rig:
    """The connected devices of one bench."""

    name: str  # "fake", "panda" or "fr3"
    title: str  # what an operator calls it
    arm: Arm
    camera: Camera
    bench: Bench
    hand_eye: HandEye
    calibration_days: int = 30  # the age from which it is warned of
    attendant: Attendant | None = None  # None: nobody is needed
    wait: Callable[[float], None] = lambda _: None
    """Lets so many seconds pass. A simulated lab's motion returns with the object at rest, so nothing is waited for."""
    await_enabled: Callable[[], None] = lambda: None
    """Returns when a person lets the arm move, so that no recording runs while it waits. Raises MotionRefused."""
    more_checks: tuple[Callable[[], Readiness], ...] = ()
    """What else must be ready before a session."""

    @property
    def is_real(self) -> bool:
        """Whether its arm can hurt somebody."""
        return not is_simulated(self.name)
