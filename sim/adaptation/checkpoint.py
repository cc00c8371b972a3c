"""Checkpoints: the results of pretraining, for use in sessions.

A checkpoint is a folder `<task>/<name>/` with `model.safetensors` (adaptation policies and, if there is one, the
emulator) and `card.toml` (task, object, ranges, seed, data, versions, held-out results). Nothing is unpickled. Shipped
ones are in `sim/checkpoints`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError

from hw.bounded import Unreadable
from hw.extras import installed
from sim.adaptation.reward_table import RewardTable, restore_reward_table
from sim.errors import CheckpointError
from sim.solvers.emulator.network import SELF_TEST, Emulator, EmulatorReport, predictions, require_same
from sim.solvers.grid import grid_behind
from sim.solvers.library import with_library
from sim.solvers.solver import naf
from sim.storage.files import Tensors, load_tensors, read_toml, save_tensors, sha256, write_toml
from sim.tasks import files_of, task_names
from sim.tasks.fingerprint import changes, content, fingerprint, interface, scene_key
from sim.tasks.library import FOLDER as POLICIES
from sim.tasks.library import read_library
from sim.tasks.task import Solver, Task

CARD = "card.toml"
FORMAT = 1
FEW = 2
"""Rollouts that stand for the physics of a task of a file."""

Targets = Literal["paper", "wide"]
"""Where targets are drawn: in the paper's ranges, or beyond them too."""


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
    """A table of the card. What this version does not know is kept as it is."""

    model_config = ConfigDict(frozen=True, extra="allow")


class Judging(_Table):
    """The sessions of the evaluation."""

    kind: Targets = "paper"
    particles: int = 2
    iterations: int = 5


class Budget(_Table):
    """The size of each stage, as far as others ask for it."""

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


MODEL = "model.safetensors"
REWARD_TABLE, GRID = "prospects.", "grid."

LARGEST = 1e12
"""The largest number that a trained network has."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A loaded checkpoint, verified against its card and its task."""

    path: Path
    card: Card
    solver: Solver
    emulator: Emulator | None  # None: the solver does not use one
    reward_table: RewardTable | None  # None with NAF, which cannot answer without simulating
    tensors: Tensors  # everything in the checkpoint's weights file

    def part(self, prefix: str) -> dict[str, NDArray[Any]]:
        """The tensors whose names begin with `prefix`, with the prefix removed: the part of one reader of the
        checkpoint.
        """
        return _part(self.tensors, prefix)

    @property
    def naf(self) -> Mapping[str, Any] | None:
        """The facts from which NAF's solver is built; None unless the policies are NAF's."""
        return self.card.naf if self.card.solver == "naf" and not self.solver.task.exact else None

    @property
    def sha256(self) -> str:
        """SHA-256 of the weights, which a session records."""
        return self.card.sha256


def save_checkpoint(
    task: Task,
    folder: Path,
    emulator: Emulator | None,
    further: Tensors,
    facts: Mapping[str, Any],
    reward_table: RewardTable | None = None,
) -> Path:
    """Write `folder`; `facts` (seed, budget, data hash, held-out results, ...) go into the card. Returns the folder.

    `emulator` is None for a task with an exact solver, and with NAF: then the facts contain its own. `further` tensors
    are those of methods (`Checkpoint.part` reads them).
    """
    tensors = {**({f"emulator.{name}": t for name, t in emulator.tensors.items()} if emulator else {}), **further}
    if reward_table is not None:
        tensors |= {f"{REWARD_TABLE}{name}": t for name, t in reward_table.tensors.items()}
    save_tensors(folder / MODEL, tensors)
    card = {
        "format": FORMAT,
        "task": task.name,
        "object": task.object_name,
        "fingerprint": fingerprint(task),
        "created": datetime.now(UTC).replace(microsecond=0),
        "sha256": sha256(folder / MODEL),
        "versions": installed("adaptsim", "drake", "numpy", "torch"),
        **facts,
        **({} if task.file is None else {"content": content(task), "scene": scene_key(task, FEW)}),
        "interface": interface(task),
        **({SELF_TEST: predictions(emulator)} if emulator else {}),
    }
    write_toml(folder / CARD, card)
    return folder


def load_checkpoint(task: Task, name: str = "default") -> Checkpoint:
    """The shipped checkpoint `name` of `task`, or the one in the folder `name`. Raises CheckpointError."""
    shipped = files_of(task.name, "checkpoints") / name
    path = shipped if (shipped / CARD).exists() else Path(name)
    card = read_card(path, task.name)
    if card.task != task.name:
        raise CheckpointError(f"the checkpoint in {path} is for {card.task}, not for {task.name}")
    if card.fingerprint != fingerprint(task):
        raise CheckpointError(
            f"the checkpoint in {path} was trained with different {_difference(card, task)} of {task.name}"
            f"{_own(card, task)}: pretrain again with `adaptsim pretrain --task {task.name}`"
            + (", or give the file of that object with --object" if task.file is None else ", in a new --out")
        )
    verify_weights(path, card)
    tensors = load_tensors(path / MODEL)
    if task.training is not None:
        task = with_library(task, read_library(path / POLICIES, card.policies))
    _require_same_physics(task, path, card)
    table = _part(tensors, REWARD_TABLE)
    _require_finite(tensors, path / MODEL)
    emulator = None if task.exact or card.solver == "naf" else Emulator(task, _part(tensors, "emulator."))
    if emulator is not None:
        require_same(emulator, card.self_test, path / CARD)
    return Checkpoint(
        path=path,
        card=card,
        solver=emulator or _solver(task, path, card, tensors),
        emulator=emulator,
        reward_table=restore_reward_table(task, table) if table else None,
        tensors=tensors,
    )


def _require_same_physics(task: Task, path: Path, card: Card) -> None:
    """Raises CheckpointError if the file of the task or of a scene has changed, and rollouts end differently."""
    if task.file is None or card.content in ("", content(task)) or card.scene == scene_key(task, FEW):
        return
    raise CheckpointError(
        f"the physics of {task.name} has changed since the checkpoint in {path} was made: its names and ranges are the "
        f"same, and rollouts end differently ({task.file.path}, or a file of its scene). Pretrain again with `adaptsim "
        f"pretrain --task {task.file.path}`, in a new --out, or restore the file"
    )


def without_phase_1(task: Task, solver: Solver) -> Checkpoint:
    """A replacement of a checkpoint if every prediction is simulated. Its hash is that of task and physics."""
    card = Card(
        format=1,
        task=task.name,
        object=task.object_name,
        fingerprint=fingerprint(task),
        interface=interface(task),
        sha256=scene_key(task, FEW),
        solver="direct",
    )
    return Checkpoint(files_of(task.name, "checkpoints") / "direct", card, solver, None, None, {})


def reward_table_of(method: str, task: Task, checkpoint: Checkpoint | None) -> RewardTable:
    """The reward table that `method` needs. Raises CheckpointError if there is none."""
    if checkpoint is None or checkpoint.reward_table is None:
        why = "there is none" if checkpoint is None else f"{checkpoint.path} holds no reward table"
        raise CheckpointError(
            f"{method} needs the reward table of the emulator or of an exact task, and {why}: make a checkpoint with "
            f"`adaptsim pretrain --task {task.name}`"
        )
    return checkpoint.reward_table


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


def verify_weights(path: Path, card: Card) -> None:
    """Raises CheckpointError unless the weights in `path` match the card."""
    model = path / MODEL
    if not model.exists():
        raise CheckpointError(f"{model} is missing: install or make the checkpoint again")
    digest = sha256(model)
    if digest != card.sha256:
        raise CheckpointError(
            f"{model} is damaged or was changed: its SHA-256 is {digest[:12]}..., the card says "
            f"{card.sha256[:12]}...; install or make the checkpoint again"
        )


def _solver(task: Task, path: Path, card: Card, tensors: Tensors) -> Solver:
    """The solver without an emulator: exact, or NAF's."""
    if task.exact:
        exact = task.exact(task)
        if (grid := grid_behind(exact)) is not None and (stored := _part(tensors, GRID)):
            grid.restore(stored)
        return exact
    try:
        solver: Solver = naf().restore(task, card.naf or {})
        return solver
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(f"the table naf in {path / CARD} is damaged ({error}): pretrain again") from error


def _require_finite(tensors: Tensors, where: Path) -> None:
    """Raise CheckpointError unless every number is finite and of a size that a trained network has."""
    for name, values in sorted(tensors.items()):
        if values.dtype.kind != "f":
            continue
        if not np.isfinite(values).all():
            raise CheckpointError(f"{where}: {name} holds numbers that are not finite: pretrain again")
        if values.size and float(np.abs(values).max()) > LARGEST:
            raise CheckpointError(
                f"{where}: {name} holds {float(np.abs(values).max()):.1e}, at most {LARGEST:.0e} is possible: pretrain "
                "again"
            )


def _part(tensors: Tensors, prefix: str) -> dict[str, NDArray[Any]]:
    return {name.removeprefix(prefix): t for name, t in tensors.items() if name.startswith(prefix)}


def _difference(card: Card, task: Task) -> str:
    now, then = interface(task), card.interface
    if task.file is not None:
        return f"settings ({'; '.join(changes(then, now))})"
    return ", ".join(key for key in now if then.get(key) != now[key]) or "settings"


def _own(card: Card, task: Task) -> str:
    """The object of the card's ranges, if it is known and differs from the present one; else ""."""
    return f" (those of {card.object})" if card.object not in (None, task.object_name) else ""
