"""Arms whose motions take longer: at a slower pace (`--pace`), or in the simulated lab at a real arm's own pace.

Without these, an arm plays a path as planned, and the simulated lab moves as fast as it can be computed. A pace is a
ratio. At the slow pace of first motions, no point of arm and tool is faster than `hw.stopping.REDUCED_M_S` either.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from adaptsim_cli.bench.devices.consent import SLOW_PACE
from hw.braking import FULL, SLOWEST, at_pace
from hw.ports import Arm, ArmWrapper
from hw.stopping import reduced_pace
from hw.types import Execution, JointPath, number
from hw.workcell import Workcell

Inner = TypeVar("Inner", bound=Arm)


def at_speed(path: JointPath, pace: float, cell: Workcell) -> JointPath:
    """`path` as it is played at `pace`. At `SLOW_PACE` and below, no point of arm and tool exceeds the reduced speed.

    Raises ValueError for a pace outside 0.1 to 1.
    """
    number(pace, "pace", SLOWEST, FULL)
    return at_pace(path, pace if pace > SLOW_PACE else reduced_pace(path, cell, pace))


class PacedArm(ArmWrapper[Inner]):
    """`hw.ports.Arm`: the inner arm checks and plays every path in stretched time; see `at_speed`.

    With `realtime` a motion also takes at least as long on the wall clock as on the arm's own clock.
    """

    def __init__(
        self,
        arm: Inner,
        cell: Workcell,
        pace: float = FULL,
        *,
        realtime: bool = False,
        now_s: Callable[[], float] = time.monotonic,
        pause: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(arm)
        self._cell, self._pace, self._realtime, self._now_s, self._pause = cell, pace, realtime, now_s, pause

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`; the execution is that of the slower path."""
        with self._taking_its_time():
            return self._arm.execute(at_speed(path, self._pace, self._cell))

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
