"""Where trials happen: the common interface of a rig (`on_rig`) and of a simulated target (`in_simulation`).

A trial is `set_up`, `plan`, `execute`, then `replay`, `track`, `evidence`; each step returns the input of the next. The
recording of `execute` is on the disk before `replay` reads it, so a trial interrupted there can continue.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from adaptsim_cli.screen.checks import Readiness
from adaptsim_cli.session.during import During, silently
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.records import KeyMoment
from adaptsim_cli.session.stages import RunTrial, TrialKey
from adaptsim_cli.session.watching import Sight
from hw.errors import HardwareError
from hw.types import Array
from perception.types import ObjectTrack, Outcome


@dataclass(frozen=True)
class TrialEvidence:
    """The files and numbers stored of a trial besides its recording and its record."""

    files: Mapping[str, bytes] = field(default_factory=dict)  # name -> content
    moments: tuple[KeyMoment, ...] = ()
    control_success_rate: float = 1.0


class Executed(Protocol):
    """A finished motion that is not stored yet."""

    @property
    def stopped(self) -> HardwareError | None:
        """Why it ended early; None: it did not.

        A recording until then is kept to look at, but does not count as a trial.
        """
        ...

    def files(self) -> Mapping[str, bytes]:
        """The recorded files, name -> content; `Target.replay` reads them."""
        ...


class TrialReplay(Protocol):
    """A finished motion, read from its stored files, not yet tracked."""

    @property
    def looking(self) -> str:
        """A sentence for the operator about `track`."""
        ...

    def track(self) -> ObjectTrack:
        """The object's track. Raises TrackingFailed."""
        ...

    def evidence(self, track: ObjectTrack) -> TrialEvidence:
        """The pictures and files that support `track`."""
        ...

    def track_px(self, track: ObjectTrack) -> Array:
        """(N, 2) the object's centre in the camera's picture; (0, 2) without a camera."""
        ...


class Planned(Protocol):
    """A trial that may be executed."""

    @property
    def summary(self) -> str:
        """The plan in one sentence."""
        ...

    @property
    def announcement(self) -> str:
        """The sentence that says what happens if the operator agrees."""
        ...

    def sight(self) -> Sight | None:
        """The picture and paths to look at before the execution; None without a camera."""
        ...

    def execute(self, during: During = silently) -> Executed:
        """Execute the trial. Raises MotionRefused, CameraError, or ArmFault if nothing was recorded."""
        ...


class Ready(Protocol):
    """One trial, set up."""

    @property
    def drawn(self) -> Array:
        """(c,) the wanted context."""
        ...

    @property
    def context(self) -> Array:
        """(c,) as measured, for the task policy."""
        ...

    @property
    def overlay(self) -> bytes | None:
        """JPEG of the detection; None without a camera."""
        ...

    def plan(self, action: Array, during: During = silently) -> Planned:
        """Plan the motion of `action` (a,).

        Raises NotExecutable, or MotionRefused naming joint, time, value and limit.
        """
        ...


class Target(Protocol):
    """The target that a session adapts to."""

    @property
    def title(self) -> str:
        """Its name for an operator."""
        ...

    @property
    def is_real(self) -> bool:
        """Whether a real robot moves."""
        ...

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes that an operator may choose between."""
        ...

    def checks(self) -> tuple[Readiness, ...]:
        """The checks of its devices."""
        ...

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """Whether an interrupted attempt is spent; if not, it is repeated from its start."""
        ...

    def set_up(self, drawn: Array, key: TrialKey, operator: Operator, during: During = silently) -> Ready:
        """Realise the `drawn` context (c,) as closely as possible. Raises HardwareError, ObjectNotFound."""
        ...

    def replay(self, context: Array, action: Array, folder: Path) -> TrialReplay:
        """The executed motion for context (c,) and action (a,), from its stored files in `folder`.

        Uses no device. Raises SessionError naming a corrupt file, ObjectNotFound.
        """
        ...
