"""What a session asks of whoever stands beside the robot; a person at a terminal, or nobody (`--yes`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from adaptsim_cli.session.policy import ExpectedReward
from adaptsim_cli.session.stages import RunTrial
from hw.types import Array
from perception.types import Outcome


@dataclass(frozen=True, eq=False)
class Proposal:
    """One trial as it is about to be executed."""

    stage: RunTrial
    parameters: Array  # (p,) the particle's mean, which the task policy was trained for
    drawn: Array  # (c,) the context that was asked for
    context: Array  # (c,) as measured
    action: Array  # (a,)
    prediction: ExpectedReward
    summary: str  # what has been planned
    announcement: str  # what happens when the operator agrees
    overlay: Path | None  # image with what the camera found, where there is one


@dataclass(frozen=True, eq=False)
class Judged:
    """One executed trial as tracking and scoring see it."""

    outcome: Outcome
    reward: float
    flags: tuple[str, ...]
    possible: tuple[tuple[Outcome, float], ...]
    """Every outcome that the track can support, with its reward."""


@dataclass(frozen=True)
class Accept:
    """The trial counts as it was tracked."""


@dataclass(frozen=True)
class Overrule:
    """The trial counts, with the outcome that the operator saw."""

    outcome: Outcome


@dataclass(frozen=True)
class Redo:
    """The trial does not count."""

    reason: str


Review = Accept | Overrule | Redo


class Operator(Protocol):
    """Every question of a session. Each may raise StoppedByOperator."""

    def repeat_interrupted(self, stage: RunTrial) -> None:
        """A motion had started and never completed. Returns when the trial may be done again."""
        ...

    def placed(self, what: str, wanted_m: Array, real: bool) -> None:
        """Returns when `what` lies at `wanted_m` (2,), or when the simulated lab may put it there."""
        ...

    def approve(self, proposal: Proposal, real: bool) -> None:
        """Returns when the trial may start."""
        ...

    def review(self, judged: Judged) -> Review:
        """Accept the tracked outcome, overrule it, or ask for the trial again."""
        ...

    def try_again(self, stage: RunTrial) -> bool:
        """Whether to set the trial up again after the object was not found, misplaced, or lost in tracking."""
        ...
