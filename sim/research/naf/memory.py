"""The NAF policies trained so far: the record for the rules of reuse, and the networks that may be reused.

A pretraining keeps them in memory, and trains again after a resume. A session keeps them in a folder, so that a
continued session has the same policies as one that was never interrupted.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from sim.errors import CheckpointError
from sim.research.naf.policy import NafPolicy, restore_policy
from sim.research.naf.reuse import PolicyRecord
from sim.storage.files import read_toml, write_toml
from sim.storage.tensors import load_tensors, save_tensors
from sim.tasks.fingerprint import fingerprint
from sim.tasks.task import Task

RECORD = "record.toml"


class NafMemory:
    """The record grows by one entry with every policy that is trained or reused. Not for subclassing."""

    def __init__(self, task: Task, folder: Path | None = None) -> None:
        """`folder` stores everything and may hold an earlier state.

        Raises CheckpointError if its content is foreign.
        """
        self.task = task
        self.record: tuple[PolicyRecord, ...] = ()
        self._folder = folder
        self._keys: list[str] = []
        self._errors: list[float] = []
        self._networks: dict[int, NafPolicy] = {}
        if folder is not None and (folder / RECORD).exists():
            self._restore(folder / RECORD)

    def find(self, key: str) -> NafPolicy | None:
        """The policy trained earlier for exactly this key, or None."""
        return self.policy(self._keys.index(key)) if self._folder is not None and key in self._keys else None

    def policy(self, position: int) -> NafPolicy:
        """The policy of a record entry that was not reused yet; with a folder, of any entry."""
        if position not in self._networks:
            assert self._folder is not None, "a policy that has already acted is not stored"
            try:
                tensors = load_tensors(self._path(position))
                self._networks[position] = restore_policy(self.task, tensors, self._errors[position])
            except RuntimeError as error:
                raise CheckpointError(
                    f"{self._path(position)} does not fit {self.task.name} ({error}): remove its folder; the policies "
                    "are then trained again"
                ) from error
        return self._networks[position]

    def add(self, record: tuple[PolicyRecord, ...], key: str, policy: NafPolicy) -> None:
        """`record` is the old record plus the entry of `policy`. With a folder, it is on the disk when this returns."""
        position = len(record) - 1
        if position != len(self.record):
            raise ValueError(f"the record has {len(self.record)} entries, so the next is not number {position}")
        self._networks[position] = policy
        self._keys.append(key)
        self._errors.append(policy.value_error)
        self.record = record
        if self._folder is not None:
            save_tensors(self._path(position), policy.network.tensors)
            write_toml(self._folder / RECORD, self._content())
        else:
            self._networks = {i: p for i, p in self._networks.items() if not record[i].donated}

    def _path(self, position: int) -> Path:
        assert self._folder is not None
        return self._folder / f"policy-{position:05d}.safetensors"

    def _content(self) -> dict[str, Any]:
        rows = zip(self.record, self._keys, self._errors, strict=True)
        return {
            "fingerprint": fingerprint(self.task),
            "policies": [
                {
                    "key": key,
                    "features": p.mean.tolist(),
                    "budget": p.budget,
                    "distributions": p.distributions,
                    "donated": p.donated,
                    "value_error": error,
                }
                for p, key, error in rows
            ],
        }

    def _restore(self, path: Path) -> None:
        try:
            stored = read_toml(path)
            found, rows = stored["fingerprint"], stored["policies"]
            self.record = tuple(
                PolicyRecord(
                    np.array(r["features"], dtype=np.float64),
                    int(r["budget"]),
                    int(r["distributions"]),
                    bool(r["donated"]),
                )
                for r in rows
            )
            self._keys = [str(r["key"]) for r in rows]
            self._errors = [float(r["value_error"]) for r in rows]
        except (KeyError, TypeError, ValueError) as error:
            raise CheckpointError(
                f"{path} is damaged ({error}): remove its folder; the policies are then trained again"
            ) from error
        if found != fingerprint(self.task):
            raise CheckpointError(
                f"the policies in {path.parent} were trained with other ranges of {self.task.name}: remove the folder, "
                "or begin another session"
            )


def policy_key(samples: Array, seed: int) -> str:
    """The key of the policy for the distribution `samples` (m, p) with the random numbers of `seed`."""
    total = hashlib.sha256(np.ascontiguousarray(samples, dtype=np.float64).tobytes() + seed.to_bytes(8, "little"))
    return total.hexdigest()[:24]
