"""Checkpoints: the results of pretraining, for use in sessions.

A checkpoint is a folder `<task>/<name>/` with `model.safetensors` (adaptation policies and, if there is one, the
emulator) and `card.toml` (task, object, ranges, seed, data, versions, held-out results). Nothing is unpickled. Shipped
ones are in `sim/checkpoints`.
"""

from __future__ import annotations

import datetime
import importlib.metadata
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from sim.adaptation.card import CARD, FORMAT, Card, card_of
from sim.adaptation.prospects import Prospects, restore_prospects
from sim.adaptation.self_test import SELF_TEST, predictions, require_finite, require_same
from sim.errors import CheckpointError
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.solver import EmulatorSolver
from sim.solvers.simulating import simulating
from sim.solvers.solver import Solver
from sim.storage.files import sha256, write_toml
from sim.storage.tensors import Tensors, load_tensors, save_tensors
from sim.tasks import files_of, get_task, task_names
from sim.tasks.fingerprint import fingerprint, interface
from sim.tasks.task import Task

__all__ = [
    "MODEL",
    "Checkpoint",
    "add_self_test",
    "list_checkpoints",
    "load_checkpoint",
    "read_card",
    "save_checkpoint",
    "verify_weights",
]

MODEL = "model.safetensors"
PROSPECTS = "prospects."


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A loaded checkpoint, verified against its card and its task."""

    path: Path
    card: Card
    solver: Solver
    emulator: Emulator | None  # None: the solver does not use one
    prospects: Prospects | None  # None with NAF, which cannot answer without simulating
    tensors: Tensors  # everything in the checkpoint's weights file

    def part(self, prefix: str) -> dict[str, NDArray[Any]]:
        """The tensors whose names begin with `prefix`, without it: what one reader of the checkpoint finds there."""
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
    prospects: Prospects | None = None,
) -> Path:
    """Write `folder`; `facts` (seed, budget, data hash, held-out results, ...) go into the card. Returns the folder.

    `emulator` is None for a task with an exact solver, and with NAF: then the facts contain its own. `further` tensors
    are those of methods (`Checkpoint.part` reads them).
    """
    tensors = {**({f"emulator.{name}": t for name, t in emulator.tensors.items()} if emulator else {}), **further}
    if prospects is not None:
        tensors |= {f"{PROSPECTS}{name}": t for name, t in prospects.tensors.items()}
    save_tensors(folder / MODEL, tensors)
    card = {
        "format": FORMAT,
        "task": task.name,
        "object": task.object_name,
        "fingerprint": fingerprint(task),
        "created": datetime.datetime.now(datetime.UTC).replace(microsecond=0),
        "sha256": sha256(folder / MODEL),
        "versions": {name: importlib.metadata.version(name) for name in ("adaptsim", "drake", "numpy", "torch")},
        **facts,
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
            f"{_own(card, task)}: pretrain again with `adaptsim pretrain --task {task.name}`, or give the file of that "
            "object with --object"
        )
    verify_weights(path, card)
    tensors = load_tensors(path / MODEL)
    ahead = _part(tensors, PROSPECTS)
    require_finite(tensors, path / MODEL)
    emulator = None if task.exact or card.solver == "naf" else Emulator(task, _part(tensors, "emulator."))
    if emulator is not None:
        require_same(emulator, card.self_test, path / CARD)
    return Checkpoint(
        path=path,
        card=card,
        solver=EmulatorSolver(emulator) if emulator else _solver(task, path, card),
        emulator=emulator,
        prospects=restore_prospects(task, ahead) if ahead else None,
        tensors=tensors,
    )


def add_self_test(folder: Path) -> bool:
    """Write the self-test into the card of a checkpoint made without one; False if it has no emulator.

    Raises CheckpointError.
    """
    card = card_of(folder)
    verify_weights(folder, card)
    tensors = load_tensors(folder / MODEL)
    require_finite(tensors, folder / MODEL)
    own = _part(tensors, "emulator.")
    if not own:
        return False
    write_toml(folder / CARD, card.facts() | {SELF_TEST: predictions(Emulator(get_task(card.task), own))})
    return True


def list_checkpoints() -> list[tuple[str, str, Path]]:
    """(task, name, folder) of every shipped checkpoint, sorted."""
    folders = {task: files_of(task, "checkpoints") for task in task_names()}
    return sorted((task, card.parent.name, card.parent) for task in folders for card in folders[task].glob(f"*/{CARD}"))


def read_card(path: Path, task: str) -> Card:
    """The card of the checkpoint in `path`. Raises CheckpointError."""
    try:
        return card_of(path)
    except FileNotFoundError as error:
        have = ", ".join(f"{t}/{n}" for t, n, _ in list_checkpoints()) or "none"
        raise CheckpointError(
            f"no checkpoint {str(path)!r} for {task} (shipped: {have}): give the name of a shipped one or a folder "
            f"that holds {CARD}, or make one with `adaptsim pretrain --task {task}`"
        ) from error


def verify_weights(path: Path, card: Card) -> None:
    """Raises CheckpointError unless the weights in `path` match the card."""
    model = path / MODEL
    if not model.exists():
        raise CheckpointError(f"{model} is missing: install or make the checkpoint again")
    found = sha256(model)
    if found != card.sha256:
        raise CheckpointError(
            f"{model} is damaged or was changed: its SHA-256 is {found[:12]}..., the card says "
            f"{card.sha256[:12]}...; install or make the checkpoint again"
        )


def _solver(task: Task, path: Path, card: Card) -> Solver:
    """The solver without an emulator: exact, or NAF's."""
    if task.exact:
        return task.exact(task)
    try:
        return simulating("naf").restore(task, card.naf or {})
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(f"the table naf in {path / CARD} is damaged ({error}): pretrain again") from error


def _part(tensors: Tensors, prefix: str) -> dict[str, NDArray[Any]]:
    return {name.removeprefix(prefix): t for name, t in tensors.items() if name.startswith(prefix)}


def _difference(card: Card, task: Task) -> str:
    now, then = interface(task), card.interface
    return ", ".join(key for key in now if then.get(key) != now[key]) or "settings"


def _own(card: Card, task: Task) -> str:
    """The object of the card's ranges, if it is known and differs from the present one; else ""."""
    return f" (those of {card.object})" if card.object not in (None, task.object_name) else ""
