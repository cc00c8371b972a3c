"""An arm whose motions are played at a slower pace (`--pace`)."""

from __future__ import annotations

from typing import TypeVar

from hw.around import AroundArm
from hw.pacing import slowed
from hw.ports import Arm, GuardedArm
from hw.types import Contact, Execution, Guard, JointPath

Inner = TypeVar("Inner", bound=Arm)


class SlowedArm(AroundArm[Inner]):
    """`hw.ports.Arm`: the inner arm checks and plays every path in stretched time."""

    def __init__(self, arm: Inner, pace: float) -> None:
        super().__init__(arm)
        self._pace = pace

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`; the execution is that of the slower path."""
        return self._arm.execute(slowed(path, self._pace))


class SlowedGuardedArm(SlowedArm[GuardedArm]):
    """`SlowedArm` for an `hw.ports.GuardedArm`."""

    def execute_until_contact(self, path: JointPath, guard: Guard) -> Contact:
        """See `hw.ports.GuardedArm`; times of the contact are those of the slower path."""
        return self._arm.execute_until_contact(slowed(path, self._pace), guard)
