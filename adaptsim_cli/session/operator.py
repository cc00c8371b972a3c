"""The questions of a session to the operator: a person at a terminal, or nobody (`--yes`)."""

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
    """One trial, ready to be executed."""

    stage: RunTrial
    parameters: Array  # (p,) the particle's mean, for which the task policy was trained
    drawn: Array  # (c,) the wanted context
    context: Array  # (c,) as measured
    action: Array  # (a,)
    prediction: ExpectedReward
    summary: str  # of the plan, one sentence
    announcement: str  # what happens if the operator agrees, one sentence
    overlay: Path | None  # picture of the detection; None without a camera


@dataclass(frozen=True, eq=False)
class Judged:
    """One executed trial, tracked and scored."""

    outcome: Outcome
    reward: float
    flags: tuple[str, ...]
    possible: tuple[tuple[Outcome, float], ...]
    """Every outcome that the track can support, with its reward."""


@dataclass(frozen=True)
class Accept:
    """The trial counts with its tracked outcome."""


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
        """A motion started and never completed. Returns once the trial may be repeated."""
        ...

    def placed(self, what: str, wanted_m: Array, real: bool) -> None:
        """Returns once `what` lies at `wanted_m` (2,), or the simulated lab may put it there."""
        ...

    def approve(self, proposal: Proposal, real: bool) -> None:
        """Returns once the trial may start."""
        ...

    def review(self, judged: Judged) -> Review:
        """Accept the tracked outcome, overrule it, or have the trial repeated."""
        ...

    def try_again(self, stage: RunTrial) -> bool:
        """Whether to set up the trial again after the object was not found, was misplaced, or was lost in tracking."""
        ...
