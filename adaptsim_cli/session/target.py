"""Where trials happen: the contract that a rig (`rig_target`) and a simulated target (`simulated_target`) fulfil.

A trial is `place`, `plan`, `execute`, then `Motion.track`; each step returns the input of the next. The files of a
motion are on the disk before it is tracked, so a trial interrupted there can continue. The devices of a rig are in
`bench.rig`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from adaptsim_cli.bench.rig import Image, Tracker
from adaptsim_cli.config import Config
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.views import Readiness
from adaptsim_cli.session.control import ControlPolicies
from adaptsim_cli.session.live_trial import Motion, PlacedTrial, PlannedTrial
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.own.exchange import Answerer, Mover
from adaptsim_cli.session.records import SessionFacts
from hw.types import Array
from perception.types import Outcome
from sim.adaptation.adaptation import Adaptation
from sim.adaptation.sessions import Progress, silently
from sim.adaptation.stages import RunTrial, TrialKey
from sim.rollouts.kept import KeptRollouts
from sim.tasks.task import Task

Placed = TypeVar("Placed", bound=PlacedTrial)
Planned = TypeVar("Planned", bound=PlannedTrial)


class Target(Mover, Protocol[Placed, Planned]):
    """The target that a session adapts to. Its own types of placed and planned trials have everything that its next
    step needs.
    """

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes that an operator may choose between."""

    def checks(self) -> tuple[Readiness, ...]:
        """The checks of its devices."""

    def goes_on(self, key: TrialKey) -> bool:
        """Whether `execute` continues an interrupted attempt as it was proposed, without beginning it again."""

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """Whether an interrupted attempt is spent; if not, it is repeated from its start."""

    def place(self, drawn: Array, key: TrialKey, operator: Operator, progress: Progress = silently) -> Placed:
        """Realise the `drawn` context (c,) as closely as possible. Raises HardwareError, ObjectNotFound."""

    def plan(self, placed: Placed, action: Array, progress: Progress = silently) -> Planned:
        """Plan the motion of `action` (a,).

        Raises NotExecutable, or MotionRefused naming joint, time, value and limit.
        """

    def execute(self, planned: Planned, progress: Progress = silently) -> Motion:
        """Execute the trial. Raises MotionRefused, CameraError, or ArmFault if nothing was recorded."""

    def read(self, folder: Path, context: Array, action: Array) -> Motion:
        """The motion for context (c,) and action (a,), from its files in `folder`, bit for bit.

        Raises SessionError naming a corrupt file.
        """


@dataclass(frozen=True)
class Provenance:
    """Where the parts come from, for the session's `SessionFacts`; never the hidden parameters of a world."""

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
class SessionParts:
    """Task, target and adaptation of one session, with their provenance."""

    task: Task
    target: Target[Any, Any]
    adaptation: Adaptation
    provenance: Provenance
    control: ControlPolicies | None = None  # of the control trials; None: there are none
    newest_picture: Callable[[], Image | None] | None = None  # (H, W, 3) RGB of the rig's camera, now; None: no camera
    worth: tuple[str, ...] = ()  # sentences about the checkpoint, before the first trial
    train_policies: Callable[[Screen], bool] | None = None
    """Trains the missing policies of the session, and returns whether there are new ones, so that the parts have to be
    opened again. None if the task trains no policies in a session."""
    rollouts: KeptRollouts | None = None  # of the direct solver; None: Phase 1 simulated them


class OpenParts(Protocol):
    """Opens all parts of a session, with its devices connected; `session.opening` does."""

    def __call__(
        self,
        config: Config,
        learnt: Path,
        *,
        own: SessionFacts | None = None,
        screen: Screen | None = None,
        answerer: Answerer | None = None,
    ) -> AbstractContextManager[SessionParts]:
        """The settings, and a folder for a solver's policies, which no other process may use meanwhile.

        With `own`, calibration and touch-off are those of this session instead of those in use. `answerer` answers for
        a robot of one's own, instead of the program or the person of the settings. Raises SimError, DeviceUnavailable,
        CalibrationMissing, UsageError.
        """


@dataclass(frozen=True)
class Openers:
    """The functions that open things. Commands get them from the program's entry, and so import only contracts."""

    parts: OpenParts
    seen_by_camera: Callable[[Config, SessionFacts], tuple[Task, tuple[Outcome, ...]]]
    """A session's task with its ranges, and its outcomes. Raises UsageError for a task without a camera."""
    tracker: Callable[[Task], Tracker]
    """The tracker of a task with a camera. Raises UnknownName, NoHardware."""
