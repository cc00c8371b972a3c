"""Policies that a task trains itself, by any training: the declaration. `sim.tasks.members` stores them."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, eq=False)
class TrainedPolicies:
    """How a task trains its policies. A policy is any object that the task's `simulate` takes as its action.

    Raises ValueError for values that contradict each other.
    """

    train: Callable[..., Any]
    """(samples, seed), also with `folder` -> arrays, a torch module, or None if it wrote files into `folder`.
    `samples` are parameters by name (`samples[0].mu`), drawn from the distribution to train for."""
    load: Callable[[Any], Any] | None = None
    """The stored arrays, state of the module (name -> tensor), or folder -> the policy. None if the arrays are the
    policy."""
    policies: int = 16  # members of the library of Phase 1, one of them trained in all of Omega
    train_in_session: bool = False  # whether a particle far from every member trains another one
    time_limit_s: float = 600.0  # of one training in a session
    distance: float = 0.16
    """D of the paper (A2.2): a policy is reused for parameters within this distance of those that it was trained for,
    normalised by their ranges."""

    def __post_init__(self) -> None:
        if not callable(self.train) or not (self.load is None or callable(self.load)):
            raise ValueError("train and load are functions")
        if self.policies < 2:
            raise ValueError(f"a library of {self.policies} policies leaves no choice: give 2 or more")
        if not (self.time_limit_s > 0.0 and self.distance >= 0.0):
            raise ValueError(
                f"the time limit of {self.time_limit_s:g} s must be above 0, and the distance {self.distance:g} not "
                "below it"
            )

    @property
    def takes_folder(self) -> bool:
        """Whether `train` is given a folder for files of its own: it has an argument `folder`."""
        return "folder" in inspect.signature(self.train).parameters
