"""Arms whose motions take longer: at a slower pace (`--pace`), or in the simulated lab at a real arm's own pace.

Without these, an arm plays a path as planned, and the simulated lab moves as fast as it can be computed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from hw.braking import FULL, slowed
from hw.ports import Arm, AroundArm, GuardedArm
from hw.types import Contact, Execution, Guard, JointPath

Inner = TypeVar("Inner", bound=Arm)
Feeling = TypeVar("Feeling", bound=GuardedArm)


class PacedArm(AroundArm[Inner]):
    """`hw.ports.Arm`: the inner arm checks and plays every path in stretched time.

    With `realtime` a motion also takes at least as long on the wall clock as on the arm's own clock.
    """

    def __init__(
        self,
        arm: Inner,
        pace: float = FULL,
        *,
        realtime: bool = False,
        now_s: Callable[[], float] = time.monotonic,
        pause: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(arm)
        self._pace, self._realtime, self._now_s, self._pause = pace, realtime, now_s, pause

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`; the execution is that of the slower path."""
        with self._taking_its_time():
            return self._arm.execute(slowed(path, self._pace))

    @contextmanager
    def _taking_its_time(self) -> Iterator[None]:
        if not self._realtime:
            yield
            return
        begun_s, before_s = self._now_s(), self._arm.state().t_s
        try:
            yield
        finally:
            moved_s = self._arm.state().t_s - before_s
            self._pause(max(0.0, moved_s - (self._now_s() - begun_s)))

    def execute_until_contact(self: PacedArm[Feeling], path: JointPath, guard: Guard) -> Contact:
        """See `hw.ports.GuardedArm`, if the inner arm is one; times of the contact are those of the slower path."""
        with self._taking_its_time():
            return self._arm.execute_until_contact(slowed(path, self._pace), guard)
