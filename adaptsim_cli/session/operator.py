"""The questions of a session to the operator: a person at a terminal, or nobody (`--yes`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from adaptsim_cli.session.records import ProposedTrial, TrialRecord
from adaptsim_cli.session.stages import RunTrial
from hw.types import Array
from perception.types import Outcome


@dataclass(frozen=True, eq=False)
class Proposal:
    """One trial, ready to be executed."""

    trial: ProposedTrial
    summary: str  # of the plan, one sentence
    announcement: str  # what happens if the operator agrees, one sentence
    overlay: Path | None  # picture of the detection; None without a camera


Choices = dict[Outcome, float]
"""Outcome that a track can support -> its reward."""


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

    def review(self, tracked: TrialRecord, choices: Choices) -> Review:
        """Accept the tracked outcome, overrule it with one of `choices`, or have the trial repeated."""
        ...

    def try_again(self, stage: RunTrial) -> bool:
        """Whether to set up the trial again after the object was not found, was misplaced, or was lost in tracking."""
        ...
