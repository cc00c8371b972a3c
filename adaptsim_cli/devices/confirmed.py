"""A real arm and hand that ask before they move: a typed word once per command, the pedal before every motion."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Literal, Self

from adaptsim_cli.devices.drivers import RealArm
from adaptsim_cli.devices.last_motion import LastMotion
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, stop
from hw.around import AroundArm
from hw.collision import Tool
from hw.errors import MotionRefused
from hw.ports import Hand, Pedal
from hw.types import Contact, Execution, Guard, HandState, JointPath

if TYPE_CHECKING:
    from hw.franka.settings import Payload

PATIENCE_S = 30.0
"""How long a motion waits for the pedal to be pressed."""
_LOOK_S = 0.02
LEAST_RATE = 0.95
"""Share of commands that should reach the arm in time, by the maker (libfranka's communication test)."""


class ConfirmedArm(AroundArm[RealArm]):
    """`hw.ports.GuardedArm` around a real one. Every motion needs the typed word; there is no way around it."""

    def __init__(
        self,
        arm: RealArm,
        where: str,
        screen: Screen,
        pedal: Pedal | None,
        *,
        table: str = "nothing on the table but the object",
        before: Callable[[], None] = lambda: None,
        last: LastMotion | None = None,
        now_s: Callable[[], float] = time.monotonic,
        pause: Callable[[float], None] = time.sleep,
    ) -> None:
        """`before` is called before every motion, with the pedal held, and raises if the motion may not begin.

        `last` remembers a motion that does not finish.
        """
        super().__init__(arm)
        self._before, self._last = before, last
        self._where, self._screen, self._pedal, self._table = where, screen, pedal, table
        self._now_s, self._pause = now_s, pause
        self._confirmed = False

    @property
    def pedal(self) -> Literal["held", "waived"]:
        """Returns "held" if it moves only while its pedal is held, "waived" without a pedal."""
        return "waived" if self._pedal is None else "held"

    def execute(self, path: JointPath) -> Execution:
        """Raises StoppedByOperator without confirmation, MotionRefused if the pedal is not held in time."""
        self.confirm()
        self.await_pedal()
        self._before()
        with self._remembered():
            played = self._arm.execute(path)
        self._say_rate(played.control_success_rate)
        return played

    def execute_until_contact(self, path: JointPath, guard: Guard) -> Contact:
        """Raises the errors of `execute` and of a guarded motion."""
        self.confirm()
        self.await_pedal()
        self._before()
        with self._remembered():
            contact = self._arm.execute_until_contact(path, guard)
        self._say_rate(contact.control_success_rate)
        return contact

    def carry(self, tool: Tool, payload: Payload) -> None:
        """Set the load on the flange from now on. Nothing moves."""
        self._arm.carry(tool, payload)

    def __enter__(self) -> Self:
        super().__enter__()
        for note in self._arm.notes:
            self._screen.note(f"  {note}")
        return self

    def confirm(self) -> None:
        """Ask the person to type the arm's model before its first motion. Raises StoppedByOperator."""
        if self._confirmed:
            return
        if (unended := self._last.unended() if self._last else None) is not None:
            self._screen.note(unended)
        self._screen.note(
            f"THE REAL ROBOT, {self._where}, is about to move for the first time. Check: nobody within its "
            f"reach, {self._table}, a hand on the arm's stop button"
            + (", a foot at the pedal." if self._pedal else ".")
        )
        agreed = Key(self.model, "to confirm", "The arm may move; the program still asks before each motion.")
        way_out = stop("The command ends; nothing has moved.")
        if self._screen.choose("Have you checked all of this?", agreed, way_out) == "q":
            raise StoppedByOperator("stopped by the operator; nothing has moved")
        self._confirmed = True

    def await_pedal(self, what: str = "arm") -> None:
        """Wait until the pedal is held. Raises MotionRefused after `PATIENCE_S`."""
        if self._pedal is None or self._pedal.enabled():
            return
        self._screen.note(f"  Hold the pedal to let the {what} move: {self._pedal.why_not()}")
        until_s = self._now_s() + PATIENCE_S
        while not self._pedal.enabled():
            if self._now_s() > until_s:
                raise MotionRefused(
                    f"{self.model}: the pedal was not held within {PATIENCE_S:g} s ({self._pedal.why_not()}); the "
                    "motion did not start. Hold the pedal and run the same command again"
                )
            self._pause(_LOOK_S)

    def _remembered(self) -> AbstractContextManager[None]:
        return nullcontext() if self._last is None else self._last.moving()

    def _say_rate(self, rate: float) -> None:
        """Warn of a low success rate after a motion."""
        told = f"{100.0 * rate:.1f} % of the commands reached the arm in time"
        if rate >= LEAST_RATE:
            self._screen.plain(f"  {told}")
            return
        self._screen.note(
            f"  Only {told} (at least {100.0 * LEAST_RATE:g} %): the computer or its network was too slow, and the "
            f"motion may have been rough. End other programs; adaptsim doctor --hw {self.model} checks both"
        )


class ConfirmedHand:
    """`hw.ports.Hand` of a confirmed arm: its fingers need the same typed word and wait for the same pedal."""

    def __init__(self, hand: Hand, arm: ConfirmedArm) -> None:
        self._hand, self._arm = hand, arm

    def __enter__(self) -> Self:
        self._hand.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self._hand.__exit__(*exc)

    def state(self) -> HandState:
        """See `hw.ports.Hand`."""
        return self._hand.state()

    def home(self) -> None:
        """See `hw.ports.Hand`."""
        self._may()
        self._hand.home()

    def move(self, width_m: float) -> None:
        """See `hw.ports.Hand`."""
        self._may()
        self._hand.move(width_m)

    def grasp(self, width_m: float, force_N: float) -> None:
        """See `hw.ports.Hand`."""
        self._may()
        self._hand.grasp(width_m, force_N)

    def _may(self) -> None:
        """Raises StoppedByOperator, MotionRefused."""
        self._arm.confirm()
        self._arm.await_pedal("hand")
