"""The hand of every lab, and the simulated lab's arm, where a person practises: they ask as a real arm does."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from adaptsim_cli.screen.release import Release
from hw.ports import Arm, ArmWrapper, GuardedArm, Hand
from hw.types import Contact, Execution, Guard, HandState, JointPath

Inner = TypeVar("Inner", bound=Arm)
Feeling = TypeVar("Feeling", bound=GuardedArm)


class ReleasedArm(ArmWrapper[Inner]):
    """`hw.ports.Arm`: no motion begins that `release` does not let begin. Each may raise StoppedByOperator."""

    def __init__(self, arm: Inner, release: Release) -> None:
        super().__init__(arm)
        self._release = release

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`."""
        self._begin(path)
        return self._arm.execute(path)

    def execute_until_contact(self: ReleasedArm[Feeling], path: JointPath, guard: Guard) -> Contact:
        """See `hw.ports.GuardedArm`, if the inner arm is one."""
        self._begin(path)
        return self._arm.execute_until_contact(path, guard)

    def _begin(self, path: JointPath) -> None:
        self._release.motion(duration_s=path.duration_s)
        self._release.begun()


class ReleasedHand:
    """`hw.ports.Hand`: its fingers move only as `release` lets them. Each motion may raise StoppedByOperator."""

    def __init__(self, hand: Hand, release: Release, enabled: Callable[[str], None] = lambda _: None) -> None:
        """`enabled` waits for the pedal of a real one, "hand" in its words. Raises MotionRefused."""
        self._hand, self._release, self._enabled = hand, release, enabled

    def __enter__(self) -> ReleasedHand:
        self._hand.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self._hand.__exit__(*exc)

    def state(self) -> HandState:
        """See `hw.ports.Hand`."""
        return self._hand.state()

    def home(self) -> None:
        """See `hw.ports.Hand`."""
        self._begin("homes its hand: the fingers open and close")
        self._hand.home()

    def move(self, width_m: float) -> None:
        """See `hw.ports.Hand`."""
        self._begin(f"moves its fingers to {1e3 * width_m:.0f} mm")
        self._hand.move(width_m)

    def grasp(self, width_m: float, force_N: float) -> None:
        """See `hw.ports.Hand`."""
        self._begin(f"closes its hand with {force_N:.0f} N")
        self._hand.grasp(width_m, force_N)

    def _begin(self, what: str) -> None:
        self._release.motion(what)
        self._enabled("hand")
        self._release.begun()
