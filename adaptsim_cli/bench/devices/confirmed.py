"""A real arm and hand that ask before they move. A command needs a typed word, and each motion a key and the pedal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, Self

from adaptsim_cli.bench.devices.consent import Consent
from adaptsim_cli.bench.devices.lab import RealArm
from adaptsim_cli.screen.release import Release
from hw.collision import Tool
from hw.errors import FingersMoved, HandError, MotionRefused
from hw.ports import ArmWrapper, Pedal
from hw.types import ArmState, Execution, JointPath
from hw.workcell import refuse_while_stopped

if TYPE_CHECKING:
    from hw.franka.motions import StopReport
    from hw.franka.settings import Payload

PATIENCE_S = 30.0
"""How long a motion waits for the pedal to be pressed."""
_LOOK_S = 0.02
LEAST_RATE = 0.95
"""Share of commands that should reach the arm in time, by the maker (libfranka's communication test)."""


class ConfirmedArm(ArmWrapper[RealArm]):
    """`hw.ports.Arm` around a real one. Every motion needs the typed word; there is no way around it."""

    def __init__(
        self,
        arm: RealArm,
        consent: Consent,
        pedal: Pedal | None,
        *,
        before: Callable[[], None] = lambda: None,
        now_s: Callable[[], float] = time.monotonic,
        pause: Callable[[float], None] = time.sleep,
    ) -> None:
        """`before` is called before every motion, with the pedal held, and raises if the motion may not begin."""
        super().__init__(arm)
        self.consent, self._before = consent, before
        self._screen, self._pedal = consent.screen, pedal
        self.release = Release(consent.screen, arm.model, True, consent.each, self.confirm, consent.completed)
        self._now_s, self._pause = now_s, pause
        self._hand_fault: str | None = None  # fingers that a stop may not have stopped

    @property
    def pedal(self) -> Literal["held", "waived"]:
        """Returns "held" if it moves only while its pedal is held, "waived" without a pedal."""
        return "waived" if self._pedal is None else "held"

    def execute(self, path: JointPath) -> Execution:
        """Raises StoppedByOperator without consent, MotionRefused if the pedal is not held in time."""
        with self._allowed(path):
            played = self._arm.execute(path)
        self._say_rate(played.control_success_rate)
        return played

    @property
    def last_stop(self) -> StopReport | None:
        """See `RealArm`."""
        return self._arm.last_stop

    def carry(self, tool: Tool, payload: Payload) -> None:
        """Set the load on the flange from now on. Nothing moves."""
        self._arm.carry(tool, payload)

    def __enter__(self) -> Self:
        super().__enter__()
        for note in self._arm.notes:
            self._screen.note(f"  {note}")
        return self

    def confirm(self) -> None:
        """Ask all questions that come once before the first motion of a command. Raises StoppedByOperator."""
        self.consent.once(self._arm)

    def await_enabled(self, what: str, path: JointPath) -> None:
        """Wait until `path`, which does `what`, is released, and for the pedal.

        Raises StoppedByOperator, MotionRefused.
        """
        self.confirm()
        self.release.path(what, path)
        self.await_pedal()

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

    def state(self) -> ArmState:
        """See `hw.ports.Arm`. A fault of the hand counts as one of the arm."""
        state = super().state()
        return replace(state, fault=state.fault or self._hand_fault, by_hand=state.by_hand and bool(state.fault))

    def recover(self) -> None:
        """See `hw.ports.Arm`. Somebody has looked at the hand, so its fault is cleared too."""
        super().recover()
        self._hand_fault = None

    @contextmanager
    def hand_moving(self) -> Iterator[None]:
        """Keeps a note on the disk during one motion of the hand, until its fingers stand still.

        If it is not certain that they do, neither arm nor hand moves before `recover`, and ArmFault is raised.
        """
        refuse_while_stopped(self._hand_fault)
        try:
            with self._noted():
                yield
        except BaseException as error:
            if not isinstance(error, HandError) or isinstance(error, FingersMoved):
                self._hand_fault = str(error) or type(error).__name__
            raise

    def _noted(self) -> AbstractContextManager[None]:
        known_arm = self.consent.known_arm
        return nullcontext() if known_arm is None else known_arm.moving()

    @contextmanager
    def _allowed(self, path: JointPath) -> Iterator[None]:
        """A context manager around one motion: consent, pedal, and a note on the disk until the motion has ended."""
        refuse_while_stopped(self._hand_fault)
        self.confirm()
        self.release.take(path.digest, duration_s=path.duration_s)
        self.await_pedal()
        self._before()
        self.release.begun()
        with self._noted():
            yield

    def _say_rate(self, rate: float) -> None:
        """Warn of a low success rate after a motion."""
        sentence = f"{100.0 * rate:.1f} % of the commands reached the arm in time"
        if rate >= LEAST_RATE:
            self._screen.plain(f"  {sentence}")
            self._screen.tell_listeners(sentence)
            return
        self._screen.note(
            f"  Only {sentence} (at least {100.0 * LEAST_RATE:g} %): the computer or its network was too slow, and the "
            f"motion may have been rough. End other programs; adaptsim doctor --hw {self.model} checks both"
        )
