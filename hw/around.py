"""An arm that wraps another arm and adds something to its motions: a question to the operator, or a sense of touch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, Self, TypeVar

from hw.ports import Arm
from hw.types import ArmState, Execution, JointPath

Inner = TypeVar("Inner", bound=Arm)


class AroundArm(ABC, Generic[Inner]):
    """`hw.ports.Arm`: the inner arm connects, reports and recovers; the subclass decides how it moves."""

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
