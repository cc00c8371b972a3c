"""An arm around another arm, for whoever adds a question, or a sense, to its motions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, Self, TypeVar

from hw.ports import Arm
from hw.types import ArmState, Execution, JointPath

Inner = TypeVar("Inner", bound=Arm)


class AroundArm(ABC, Generic[Inner]):
    """`hw.ports.Arm`: the inner arm connects, reports and recovers; how it is moved is the subclass's."""

    def __init__(self, arm: Inner) -> None:
        self._arm = arm

    @property
    def model(self) -> str:
        """See `hw.ports.Arm`."""
        return self._arm.model

    def __enter__(self) -> Self:
        self._arm.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self._arm.__exit__(*exc)

    def state(self) -> ArmState:
        """See `hw.ports.Arm`."""
        return self._arm.state()

    def recover(self) -> None:
        """See `hw.ports.Arm`."""
        self._arm.recover()

    @abstractmethod
    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`."""
        ...
