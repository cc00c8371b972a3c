"""The NAF policies trained so far: the record for the rules of reuse, and the networks that may be reused.

A pretraining keeps them in memory, and trains them again after an interruption. A session keeps them in a folder, so
that a continued session has the same policies as one that was never interrupted.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from sim.errors import CheckpointError
from sim.research.naf.policy import NafPolicy, restore_policy
from sim.storage.files import load_tensors, read_toml, save_tensors, write_toml
from sim.tasks.fingerprint import fingerprint
from sim.tasks.task import ReuseRules, Task


@dataclass(frozen=True, eq=False)
class PolicyRecord:
    """The facts about one distribution's policy that the rules need."""

    mean: Array  # (p,) normalised; for wide distributions (2p,), see `features`
    budget: int  # rollouts of its training, those of its donors included
    distributions: int  # j: number of distributions it was trained with
    donated: bool = False  # a donor donates once, so that no policy serves too many distributions


@dataclass(frozen=True, eq=False)
class TrainingPlan:
    """The training for a new distribution, and the record with it added (last)."""

    donor: int | None  # position in the record: training starts from its weights
    budget: int  # rollouts for training; 0: use the donor's policy unchanged
    record: tuple[PolicyRecord, ...]


def features(samples: Array) -> Array:
    """Samples (m, p) of a distribution, normalised -> (2p,), means and then standard deviations.

    The distance between two of them is the 2-Wasserstein distance of two Gaussians with diagonal covariance. For narrow
    distributions it is the distance of the means, as in the paper. It also keeps a policy for all of the ranges apart
    from one for their middle.
    """
    return np.concatenate([samples.mean(axis=0), samples.std(axis=0)])


def plan_training(record: tuple[PolicyRecord, ...], mean: Array, rules: ReuseRules) -> TrainingPlan:
    """The training plan for the distribution with `mean` (p,), or `features` (2p,), normalised by the ranges.

    The nearest policy within D whose weights have not been reused yet becomes the donor. Training continues with
    max(M_min, alpha^(j - 1) M) rollouts, where j counts the new distribution, and never beyond M_max in total.
    """
    gaps = [np.inf if p.donated else float(np.linalg.norm(p.mean - mean)) for p in record]
    donor = int(np.argmin(gaps)) if gaps and min(gaps) <= rules.distance else None
    if donor is None:
        fresh = PolicyRecord(mean, rules.first_budget, 1)
        return TrainingPlan(None, rules.first_budget, (*record, fresh))
    before = record[donor]
    j = before.distributions + 1
    target = max(rules.least_budget, round(rules.discount ** (j - 1) * rules.first_budget))
    budget = max(0, min(target, rules.max_budget - before.budget))
    records = tuple(replace(p, donated=True) if i == donor else p for i, p in enumerate(record))
    return TrainingPlan(donor, budget, (*records, PolicyRecord(mean, before.budget + budget, j)))


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
            stored_fingerprint, rows = stored["fingerprint"], stored["policies"]
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
        if stored_fingerprint != fingerprint(self.task):
            raise CheckpointError(
                f"the policies in {path.parent} were trained with other ranges of {self.task.name}: remove the folder, "
                "or begin another session"
            )


def policy_key(samples: Array, seed: int) -> str:
    """The key of the policy for the distribution `samples` (m, p) with the random numbers of `seed`."""
    total = hashlib.sha256(np.ascontiguousarray(samples, dtype=np.float64).tobytes() + seed.to_bytes(8, "little"))
    return total.hexdigest()[:24]
