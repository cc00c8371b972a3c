"""The training of a policy into a folder, and its loading.

Nothing is unpickled. The return value of `train` decides the files: arrays become `policy.npz`, a torch module becomes
`policy.safetensors` (its state), and `None` means that `train` has written files of its own into the folder.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from hw.types import Array
from sim.errors import CheckpointError, TaskError
from sim.storage.files import load_tensors, publish_new, read_toml, save_tensors
from sim.tasks.files import user_code
from sim.tasks.task import Task

POLICY = "policy.toml"
ARRAYS, STATE = "policy.npz", "policy.safetensors"
ALONE = "policy"
"""The name of an array that was returned alone; those of a sequence are numbers."""


@dataclass(frozen=True, eq=False)
class Member:
    """A stored policy."""

    name: str
    folder: Path
    trained_for: Array  # (p,) parameters in units; the middle of Omega for one trained in all of it
    sha256: str  # of its files
    seconds: float  # of its training


def train_member(task: Task, name: str, samples: Array, trained_for: Array, seed: int, folder: Path) -> Member:
    """Train the policy of `samples` (m, p) and store it as `folder`, whole or not at all; a stored one is read.

    Raises TaskError if the task's `train` fails or returns something that cannot be stored.
    """
    if not (folder / POLICY).exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=folder.parent))
        try:
            began = time.perf_counter()
            _store(_trained(task, samples, seed, temporary), temporary, task.name)
            content = {
                "task": task.name,
                "name": name,
                "trained_for": dict(zip(task.parameters.names, map(float, trained_for), strict=True)),
                "seed": seed,
                "seconds": round(time.perf_counter() - began, 3),
                "sha256": _digest(temporary),
            }
            (temporary / POLICY).write_text(tomli_w.dumps(content), encoding="utf-8")
            publish_new(temporary, folder)
        except FileExistsError:  # another process was first
            shutil.rmtree(temporary, ignore_errors=True)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
    return read_member(folder)


def read_member(folder: Path) -> Member:
    """The stored policy in `folder`. Raises CheckpointError if it is missing or was changed."""
    try:
        table = read_toml(folder / POLICY)
        values = np.array(list(table["trained_for"].values()), dtype=np.float64)
        member = Member(str(table["name"]), folder, values, str(table["sha256"]), float(table["seconds"]))
    except (OSError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise CheckpointError(f"{folder / POLICY} cannot be read ({error}): pretrain again") from error
    if _digest(folder) != member.sha256:
        raise CheckpointError(f"the policy in {folder} was changed after its training: pretrain again")
    return member


def load_policy(task: Task, member: Member) -> Any:
    """The policy as `simulate` takes it. Raises CheckpointError; TaskError if the task's `load` fails."""
    assert task.training is not None
    folder, load = member.folder, task.training.load
    stored: Any = folder
    if (folder / ARRAYS).exists():
        stored = _arrays(folder / ARRAYS)
    elif (folder / STATE).exists():
        from safetensors.torch import load_file  # noqa: PLC0415 - only for tasks with torch modules

        load_tensors(folder / STATE)  # refuses a damaged file
        stored = load_file(folder / STATE)
    if load is None:
        return stored
    path = task.file.path if task.file else None
    failing = f"`load` of the task {task.name} fails with the policy {member.name} in {folder}"
    with user_code(path, lambda failure: f"{failing}: it {failure}"):
        return load(stored)


def _trained(task: Task, samples: Array, seed: int, folder: Path) -> Any:
    training = task.training
    assert training is not None
    named = [task.parameters.named(row) for row in samples]

    def sentence(failure: str) -> str:
        such = ", ".join(f"{name} = {value}" for name, value in vars(named[0]).items())
        return f"`train` of the task {task.name} fails with seed {seed} for parameters such as {such}: it {failure}"

    with user_code(task.file.path if task.file else None, sentence):
        return training.train(named, seed, folder=folder) if training.takes_folder else training.train(named, seed)


def _store(result: Any, folder: Path, task: str) -> None:
    if result is None:
        if not any(folder.iterdir()):
            raise TaskError(
                f"`train` of the task {task} returns nothing and wrote no file: return arrays or a torch module, or "
                "take an argument `folder` and write into it"
            )
        return
    if callable(getattr(result, "state_dict", None)):
        tensors = {name: tensor.detach().cpu().numpy() for name, tensor in result.state_dict().items()}
        _require_numbers(tensors, task)
        save_tensors(folder / STATE, tensors)
        return
    arrays = _named_arrays(result, task)
    _require_numbers(arrays, task)
    np.savez(folder / ARRAYS, **arrays)


def _named_arrays(result: Any, task: str) -> dict[str, Any]:
    if isinstance(result, Mapping):
        if not all(isinstance(name, str) and name.isidentifier() for name in result):
            raise TaskError(f"`train` of the task {task} returns names {list(result)}: each must be a word")
        return {f"name_{name}": np.asarray(value) for name, value in result.items()}
    if isinstance(result, Sequence) and not isinstance(result, str) and any(np.ndim(one) for one in result):
        return {str(i): np.asarray(value) for i, value in enumerate(result)}
    return {ALONE: np.asarray(result)}


def _require_numbers(arrays: Mapping[str, Any], task: str) -> None:
    for name, array in arrays.items():
        if array.dtype.kind not in "biuf":
            raise TaskError(
                f"`train` of the task {task} returns {name} of type {array.dtype}: return arrays of numbers, a torch "
                "module, or take an argument `folder` and write files into it"
            )
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise TaskError(f"`train` of the task {task} returns numbers that are not finite ({name}): it diverged")


def _arrays(path: Path) -> Any:
    """The arrays as they were returned: one, a sequence, or by name."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    if ALONE in arrays:
        return arrays[ALONE]
    if all(name.isdigit() for name in arrays):
        return tuple(arrays[str(i)] for i in range(len(arrays)))
    return {name.removeprefix("name_"): array for name, array in arrays.items()}


def _digest(folder: Path) -> str:
    """A digest of the names and contents of all files except `POLICY`."""
    total = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and p != folder / POLICY):
        total.update(str(path.relative_to(folder)).encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()
