"""The card of a checkpoint: everything about it except its weights."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from hw.bounded import Unreadable
from sim.errors import CheckpointError
from sim.storage.files import read_toml
from sim.tasks import files_of, task_names
from sim.types import EmulatorReport

CARD = "card.toml"
FORMAT = 1

Targets = Literal["paper", "wide"]
"""Where targets are drawn: only in the paper's ranges, or also beyond them."""


@dataclass(frozen=True)
class MethodScore:
    """The score of a method after each iteration: of its final policy at that point, by true rollouts."""

    name: str
    reward: tuple[float, ...]  # mean over the targets
    gap_closed: tuple[float, ...]  # pooled over the targets with a gap; 0 if there is none
    gap_closed_ci95: tuple[tuple[float, float], ...]  # bootstrap over targets
    above_udr_ci95: tuple[float, float]  # of the mean difference to UDR after the last iteration, all targets


@dataclass(frozen=True)
class EvaluationReport:
    """Mean rewards over the targets, all by true rollouts."""

    kind: Targets
    targets: int
    trials: int  # per session
    rollouts: int  # behind each reward
    udr: float  # mean over several of its policies
    oracle: float  # the best E in Omega: proposed by the solver, confirmed by true rollouts
    targets_with_gap: int  # oracle - udr at least LEAST_GAP
    methods: tuple[MethodScore, ...]
    pairs: int  # of (policy, target), behind the next two figures
    emulator_correlation: float  # of the solver's rewards with true ones over the pairs; 1 for an exact solver
    emulator_bias: float  # mean of the solver's - true; 0 for an exact solver


class _Table(BaseModel):
    """A table of the card. Keys that this version does not know are kept as they are."""

    model_config = ConfigDict(frozen=True, extra="allow")


class Judging(_Table):
    """The sessions of the evaluation."""

    kind: Targets = "paper"
    particles: int = 2
    iterations: int = 5


class Budget(_Table):
    """The sizes of the stages that other code needs."""

    rollouts: int = 0  # of the dataset, spread evenly
    denser: int = 0  # further ones where the outcome is uncertain
    evaluation: Judging = Judging()


class Card(_Table):
    """Everything about a checkpoint except its weights."""

    format: Literal[1]
    task: str
    object: str | None = None  # of its ranges; None: not stated
    fingerprint: str  # of the task
    interface: dict[str, Any]  # behind the fingerprint: spaces, observation, noise
    sha256: str  # of the weights
    content: str = ""  # of the file of the task and of its scenes; empty: the task of a package
    scene: str = ""  # key of the physics of such a task
    created: datetime | None = None
    versions: dict[str, str] = {}  # of the packages that it was made with
    seed: int | None = None
    simulations: int = 0
    solver: Literal["emulator", "naf", "direct"] = "emulator"
    naf: dict[str, Any] | None = None  # read by NAF's solver
    budget: Budget = Budget()
    self_test: list[float] | None = None  # predictions repeated on loading; None: no emulator
    policies: dict[str, str] = {}  # name -> SHA-256 of each trained policy, in the folder `policies`
    worth: dict[str, Any] | None = None  # see `sim.research.pretraining.worth`; None: not measured
    emulator: EmulatorReport | None = None  # None: no emulator was trained
    evaluation: EvaluationReport | None = None  # None: not asked for

    def facts(self) -> dict[str, Any]:
        """The card as it was written, ready for TOML."""
        return self.model_dump(exclude_unset=True)


def card_of(path: Path) -> Card:
    """The card of the checkpoint in the folder `path`. Raises FileNotFoundError, CheckpointError."""
    try:
        raw = read_toml(path / CARD)
        if (stored_format := raw.get("format", FORMAT)) != FORMAT:
            raise CheckpointError(
                f"{path} has checkpoint format {stored_format}, this version reads {FORMAT}: pretrain again"
            )
        return Card.model_validate(raw)
    except Unreadable as error:
        raise CheckpointError(f"{path / CARD} {error}; make the checkpoint again") from error
    except ValidationError as error:
        raise _wrong(path / CARD, error) from error


def _wrong(file: Path, error: ValidationError) -> CheckpointError:
    errors_by_key = {".".join(map(str, one["loc"])): one for one in error.errors()}
    missing = ", ".join(sorted(name for name, one in errors_by_key.items() if one["type"] == "missing"))
    if missing:
        return CheckpointError(f"{file} has no {missing}: install or make the checkpoint again")
    name, first = next(iter(errors_by_key.items()))
    return CheckpointError(f"{file} has a wrong {name} ({first['msg']}): install or make the checkpoint again")


def list_checkpoints() -> list[tuple[str, str, Path]]:
    """(task, name, folder) of every shipped checkpoint, sorted."""
    folders = {task: files_of(task, "checkpoints") for task in task_names()}
    return sorted((task, card.parent.name, card.parent) for task in folders for card in folders[task].glob(f"*/{CARD}"))


def read_card(path: Path, task: str) -> Card:
    """The card of the checkpoint in `path`. Raises CheckpointError."""
    try:
        return card_of(path)
    except FileNotFoundError as error:
        shipped = [name for of, name, _ in list_checkpoints() if of == task]
        have = f"(shipped: {', '.join(shipped)})" if shipped else "(none is shipped)"
        raise CheckpointError(
            f"no checkpoint {str(path)!r} for {task} {have}: make one with `adaptsim pretrain --task {task}`, or give "
            f"{'a shipped name, or ' if shipped else ''}a folder that holds {CARD}"
        ) from error
