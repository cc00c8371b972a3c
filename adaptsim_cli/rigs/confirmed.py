"""A real arm that asks before it moves: typed once a command, and for the pedal before every motion."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Self

from adaptsim_cli.console import Screen
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.rigs.openers import Pedal
from hw.errors import MotionRefused
from hw.ports import Arm
from hw.types import ArmState, Execution, JointPath

PATIENCE_S = 30.0
"""How long a motion waits for the pedal to be pressed."""
_LOOK_S = 0.02


class ConfirmedArm:
    """`hw.ports.Arm` around a real one. No way leads around the typed word: `execute` itself asks for it."""

    def __init__(
        self,
        arm: Arm,
        where: str,
        screen: Screen,
        pedal: Pedal | None,
        *,
        now_s: Callable[[], float] = time.monotonic,
        pause: Callable[[float], None] = time.sleep,
    ) -> None:
        self._arm, self._where, self._screen, self._pedal = arm, where, screen, pedal
        self._now_s, self._pause = now_s, pause
        self._confirmed = False

    @property
    def model(self) -> str:
        return self._arm.model

    def __enter__(self) -> Self:
        self._arm.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self._arm.__exit__(*exc)

    def state(self) -> ArmState:
        return self._arm.state()

    def recover(self) -> None:
        self._arm.recover()

    def execute(self, path: JointPath) -> Execution:
        """Raises StoppedByOperator where it is not confirmed, MotionRefused where the pedal is not held in time."""
        self.confirm()
        self._await_pedal()
        return self._arm.execute(path)

    def confirm(self) -> None:
        """Have the arm's model typed before its first motion. Raises StoppedByOperator."""
        if self._confirmed:
            return
        self._screen.note(
            f"THE REAL ROBOT, {self._where}, is about to move for the first time. Nobody in its range, nothing on the "
            "table but the object, a hand at the arm's stop button" + (", a foot at the pedal." if self._pedal else ".")
        )
        while (answer := self._screen.ask(f"Type {self.model} when that is so, q to stop:")) != self.model:
            if answer == "q":
                raise StoppedByOperator("stopped by the operator; nothing has moved")
        self._confirmed = True

    def _await_pedal(self) -> None:
        if self._pedal is None or self._pedal.enabled():
            return
        self._screen.note(f"  Hold the pedal to let the arm move: {self._pedal.why_not()}")
        until_s = self._now_s() + PATIENCE_S
        while not self._pedal.enabled():
            if self._now_s() > until_s:
                raise MotionRefused(
                    f"{self.model}: the pedal was not held within {PATIENCE_S:g} s ({self._pedal.why_not()}); this "
                    "motion has not begun"
                )
            self._pause(_LOOK_S)
