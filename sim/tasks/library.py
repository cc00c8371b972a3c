"""A library of trained policies. Its members take the place of the actions of their task.

An action is the parameters that a policy was trained for. So everything that compares actions, such as the discrepancy
of reality, measures the distance between the parameters of two policies, in fractions of the ranges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack
from sim.errors import CheckpointError
from sim.tasks.members import POLICY, Member, load_policy, read_member
from sim.tasks.task import Task

FOLDER = "policies"


@dataclass(frozen=True, eq=False)
class PolicyLibrary:
    """Trained policies of one task."""

    members: tuple[Member, ...]
    _loaded: dict[str, Any] = field(default_factory=dict, repr=False)  # by name

    def __reduce__(self) -> Any:
        return PolicyLibrary, (self.members,)  # another process loads the policies itself

    @cached_property
    def places(self) -> Array:
        """(K, p) the parameters that the members were trained for, in units: the actions of the task."""
        return np.stack([member.trained_for for member in self.members])

    def nearest(self, task: Task, action: Array) -> Member:
        """The member trained for the parameters nearest to `action` (p,)."""
        gaps = task.parameters.normalise(self.places) - task.parameters.normalise(action)
        return self.members[int(np.linalg.norm(gaps, axis=1).argmin())]

    def distance(self, task: Task, parameters: Array) -> float:
        """The distance from parameters (p,) to those of the nearest member, in fractions of the ranges."""
        gaps = task.parameters.normalise(self.places) - task.parameters.normalise(parameters)
        return float(np.linalg.norm(gaps, axis=1).min())

    def policy(self, task: Task, member: Member) -> Any:
        """The policy of a member, loaded once in a process. Raises TaskError, CheckpointError."""
        if member.name not in self._loaded:
            self._loaded[member.name] = load_policy(task, member)
        return self._loaded[member.name]


@dataclass(frozen=True, eq=False)
class LibraryRollouts:
    """A `sim.tasks.task.Simulate` whose action names a member of the library."""

    task: Task  # whose `simulate` takes a policy
    library: PolicyLibrary

    def __call__(
        self, parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None
    ) -> ObjectTrack:
        """See `Simulate`; the action (p,) is the parameters that the policy was trained for."""
        policy = self.library.policy(self.task, self.library.nearest(self.task, action))
        return self.task.simulate(parameters, context, policy, nuisance, unmodelled)


def library_of(task: Task) -> PolicyLibrary | None:
    """The library whose members are the actions of the task; None for other tasks."""
    return task.simulate.library if isinstance(task.simulate, LibraryRollouts) else None


def read_library(folder: Path, digests: dict[str, str]) -> PolicyLibrary:
    """The members in `folder`, as its checkpoint's card names them (name -> SHA-256). Raises CheckpointError."""
    members = tuple(read_member(folder / name) for name in digests)
    changed = [member.name for member in members if digests[member.name] != member.sha256]
    if changed:
        raise CheckpointError(
            f"the policies {', '.join(changed)} in {folder} are not those of the card: pretrain again"
        )
    return PolicyLibrary(members)


def main_file(member: Member) -> Path:
    """The file to pass on: the policy's only file, or its folder if there are several files."""
    files = sorted(path for path in member.folder.iterdir() if path.name != POLICY)
    return files[0] if len(files) == 1 else member.folder


def digests_of(members: Sequence[Member]) -> dict[str, str]:
    """Name -> SHA-256, for a card."""
    return {member.name: member.sha256 for member in members}
