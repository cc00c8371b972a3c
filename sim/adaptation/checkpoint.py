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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.extras import installed
from sim.adaptation.card import CARD, FORMAT, Card, read_card
from sim.adaptation.reward_table import RewardTable, restore_reward_table
from sim.errors import CheckpointError
from sim.solvers.emulator.network import SELF_TEST, Emulator, predictions, require_same
from sim.solvers.grid import grid_behind
from sim.solvers.library import with_library
from sim.solvers.solver import naf
from sim.storage.files import Tensors, load_tensors, save_tensors, sha256, write_toml
from sim.tasks import files_of
from sim.tasks.fingerprint import changes, content, fingerprint, interface, scene_key
from sim.tasks.library import FOLDER as POLICIES
from sim.tasks.library import read_library
from sim.tasks.task import Solver, Task

FEW = 2
"""Number of rollouts that represent the physics of a task from a file."""

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
    """The replacement of a checkpoint for a session in which every prediction is simulated. Its hash is that of task
    and physics.
    """
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
