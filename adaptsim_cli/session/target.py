"""Where trials happen: what the sequence asks of a rig (`on_rig`) and of a simulated target (`in_simulation`).

A trial is `set_up`, `plan`, `execute`, then `replay`, `track`, `evidence`; each step hands over what the next needs.
What `execute` recorded is on the disk before `replay` reads it, so a trial that is cut short there can go on.
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
    """What is kept of a trial beside its recording and its record."""

    files: Mapping[str, bytes] = field(default_factory=dict)  # name -> content
    moments: tuple[KeyMoment, ...] = ()
    control_success_rate: float = 1.0


class Executed(Protocol):
    """A motion that is over and not stored yet."""

    @property
    def stopped(self) -> HardwareError | None:
        """Why it did not come to its end; what was recorded until then is worth a look, but is no trial."""
        ...

    def files(self) -> Mapping[str, bytes]:
        """All that was recorded, name -> content: what `Target.replay` reads."""
        ...


class TrialReplay(Protocol):
    """A motion that is over, read from what was stored of it, and not looked at yet."""

    @property
    def looking(self) -> str:
        """What `track` does, for the operator."""
        ...

    def track(self) -> ObjectTrack:
        """Raises TrackingFailed."""
        ...

    def evidence(self, track: ObjectTrack) -> TrialEvidence:
        """Reward and observation of `track`, with what supports them."""
        ...

    def track_px(self, track: ObjectTrack) -> Array:
        """(N, 2) the object's centre in the picture of the camera; (0, 2) where there is none."""
        ...


class Planned(Protocol):
    """A trial that may be executed."""

    @property
    def summary(self) -> str:
        """What has been planned, in one sentence."""
        ...

    @property
    def announcement(self) -> str:
        """What is going to happen when the operator agrees."""
        ...

    def sight(self) -> Sight | None:
        """What there is to look at before it is executed; None where there is no camera."""
        ...

    def execute(self, during: During = silently) -> Executed:
        """Raises MotionRefused, CameraError, or ArmFault where nothing was recorded."""
        ...


class Ready(Protocol):
    """Everything is in its place for one trial."""

    @property
    def drawn(self) -> Array:
        """(c,) the context that was asked for."""
        ...

    @property
    def context(self) -> Array:
        """(c,) as measured, for the task policy."""
        ...

    @property
    def overlay(self) -> bytes | None:
        """JPEG of what the camera found; None where there is no camera."""
        ...

    def plan(self, action: Array, during: During = silently) -> Planned:
        """Raises NotExecutable, or MotionRefused naming joint, time, value and limit."""
        ...


class Target(Protocol):
    """What a session adapts to."""

    @property
    def title(self) -> str:
        """What an operator calls it."""
        ...

    @property
    def is_real(self) -> bool:
        """Whether a real robot moves."""
        ...

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """How a trial can end, for an operator who saw it otherwise."""
        ...

    def checks(self) -> tuple[Readiness, ...]:
        """Whether it is ready."""
        ...

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """Whether an attempt that was cut short in the middle is spent; if not, it is done again from its start."""
        ...

    def set_up(self, drawn: Array, key: TrialKey, operator: Operator, during: During = silently) -> Ready:
        """Make the `drawn` context (c,) true, as far as it can be. Raises HardwareError, ObjectNotFound."""
        ...

    def replay(self, context: Array, action: Array, folder: Path) -> TrialReplay:
        """The motion that was executed for context (c,) and action (a,), from what was stored of it in `folder`.

        No device is asked. Raises SessionError naming a file that is corrupt, ObjectNotFound.
        """
        ...
