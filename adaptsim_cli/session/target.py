"""Where trials happen: the contract that a rig (`rig_target`) and a simulated target (`simulated_target`) fulfil.

A trial is `place`, `plan`, `execute`, then `Motion.track`; each step returns the input of the next. The files of a
motion are on the disk before it is tracked, so a trial interrupted there can continue. Below stand the parts of a rig.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from adaptsim_cli.bench.facts import RigFacts
from adaptsim_cli.bench.rig import Detection, Image, Paths
from adaptsim_cli.config import is_simulated
from adaptsim_cli.screen.release import Release
from adaptsim_cli.screen.views import Readiness
from adaptsim_cli.session.control import ControlPolicies
from adaptsim_cli.session.live_trial import Motion, Placement
from adaptsim_cli.session.operator import Operator
from calib.types import HandEye
from hw.braking import slowed
from hw.ports import Arm, Camera, ObjectPlacer
from hw.types import Array, CameraModel, Frame, JointPath
from perception.types import ObjectTrack, Outcome
from sim.adaptation.learner import Learner
from sim.adaptation.sessions import Progress, silently
from sim.adaptation.stages import RunTrial, TrialKey
from sim.tasks.task import Task
from sim.types import ToolMotion


class Target(Protocol):
    """The target that a session adapts to."""

    @property
    def title(self) -> str:
        """Its name for an operator."""

    @property
    def moves(self) -> bool:
        """Whether something real moves, so that an interrupted attempt is spent."""

    @property
    def needs_consent(self) -> bool:
        """Whether a person confirms every motion at the terminal, also with --yes."""

    @property
    def owns_devices(self) -> bool:
        """Whether this program connects an arm and a camera, its own or those of the simulated lab."""

    @property
    def release(self) -> Release:
        """The questions that let its arm move; those of nobody where there is no arm."""

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes that an operator may choose between."""

    def checks(self) -> tuple[Readiness, ...]:
        """The checks of its devices."""

    def goes_on(self, key: TrialKey) -> bool:
        """Whether `execute` goes on with an interrupted attempt as it was proposed, and begins nothing again."""

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """Whether an interrupted attempt is spent; if not, it is repeated from its start."""

    def place(self, drawn: Array, key: TrialKey, operator: Operator, progress: Progress = silently) -> Placement:
        """Realise the `drawn` context (c,) as closely as possible. Raises HardwareError, ObjectNotFound."""

    def plan(self, placed: Placement, action: Array, progress: Progress = silently) -> Placement:
        """Plan the motion of `action` (a,).

        Raises NotExecutable, or MotionRefused naming joint, time, value and limit.
        """

    def execute(self, planned: Placement, progress: Progress = silently) -> Motion:
        """Execute the trial. Raises MotionRefused, CameraError, or ArmFault if nothing was recorded."""

    def read(self, folder: Path, context: Array, action: Array) -> Motion:
        """The motion for context (c,) and action (a,), from its files in `folder`, bit for bit.

        Raises SessionError naming a corrupt file.
        """


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
    at_home: Callable[[ObjectTrack, Any, Frame, Frame, CameraModel, Array], ObjectTrack] = lambda track, *_: track
    """(track, detection, picture before, picture after, model, X_BC) -> the track, with the outcome as the arm is home.

    For a task that carries its object.
    """
    lies_at_home: Callable[[ObjectTrack, Any, Frame, Frame, CameraModel, Array], ObjectTrack | None] = lambda *_: None
    """As `at_home`, for a hidden end -> the track with its outcome; None: the picture does not show it."""


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
        """Before `what` is placed: the confirmation, the way home, the weighing.

        Raises NotExecutable, MotionRefused, StoppedByOperator.
        """

    def facts(self) -> RigFacts:
        """The facts of the rig after a trial."""


@dataclass(frozen=True)
class Rig:
    """The connected devices of one bench."""

    name: str  # "fake", "panda" or "fr3"
    title: str  # its name for an operator
    arm: Arm
    camera: Camera
    bench: ObjectPlacer
    hand_eye: HandEye
    calibration_days: int = 30  # an older calibration gives a warning
    attendant: Attendant | None = None  # None: nobody is needed
    wait: Callable[[float], None] = lambda _: None
    """(duration in s) -> None: wait. A simulated motion returns with the object at rest, so the lab does not wait."""
    await_enabled: Callable[[str, float], None] = lambda what, duration_s: None
    """Waits until the operator lets the next motion begin, which does `what` for `duration_s`, so that no recording
    runs meanwhile. Raises StoppedByOperator, MotionRefused."""
    more_checks: tuple[Callable[[], Readiness], ...] = ()
    """Further checks before a session."""
    pace: float = 1.0  # of every motion; below 1 a trial is a rehearsal, which counts for nothing
    release: Release = field(default_factory=Release)  # the questions that let the arm move

    @property
    def is_real(self) -> bool:
        """Whether a real arm moves, which can hurt somebody."""
        return not is_simulated(self.name)


@dataclass(frozen=True)
class Provenance:
    """Where the parts come from, for the session's `Facts`; never the hidden parameters of a world."""

    checkpoint: str
    checkpoint_sha256: str
    world_sha256: str  # "": real hardware
    calibration: str  # "": no camera
    calibration_sha256: str
    versions: dict[str, str]
    camera_late_s: float = 0.0  # subtracted from the camera's time stamps
    start_from_sha256: str = ""  # of the posterior that the session begins with
    control_sha256: str = ""  # of the record of the control's session
    checkpoint_folder: str = ""  # of a checkpoint that does not ship


@dataclass(frozen=True)
class Parts:
    """Task, target and learner of one session, with their provenance."""

    task: Task
    target: Target
    learner: Learner
    provenance: Provenance
    control: ControlPolicies | None = None  # of the control trials; None: there are none
    newest_picture: Callable[[], Image | None] | None = None  # (H, W, 3) RGB of the rig's camera, now; None: no camera
