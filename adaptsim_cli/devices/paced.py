"""The simulated lab at the arm's real pace, to be watched.

Without this, the lab moves as fast as it can be computed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from hw.around import AroundArm
from hw.ports import Arm, GuardedArm
from hw.types import Contact, Execution, Guard, JointPath

Inner = TypeVar("Inner", bound=Arm)


class PacedArm(AroundArm[Inner]):
    """An `hw.ports.Arm`. Its motions take at least as long on the wall clock as on the arm's own clock."""

    def __init__(
        self, arm: Inner, now_s: Callable[[], float] = time.monotonic, pause: Callable[[float], None] = time.sleep
    ) -> None:
        super().__init__(arm)
        self._now_s, self._pause = now_s, pause

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`."""
        with self._taking_its_time():
            return self._arm.execute(path)

    @contextmanager
    def _taking_its_time(self) -> Iterator[None]:
        begun_s, before_s = self._now_s(), self._arm.state().t_s
        try:
            yield
        finally:
            moved_s = self._arm.state().t_s - before_s
            self._pause(max(0.0, moved_s - (self._now_s() - begun_s)))


class PacedGuardedArm(PacedArm[GuardedArm]):
    """`PacedArm` for an `hw.ports.GuardedArm`."""

    def execute_until_contact(self, path: JointPath, guard: Guard) -> Contact:
        """See `hw.ports.GuardedArm`."""
        with self._taking_its_time():
            return self._arm.execute_until_contact(path, guard)
