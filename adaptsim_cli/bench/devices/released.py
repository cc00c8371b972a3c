"""The hand of every lab, and the simulated lab's arm for practice. Both ask before they move, as a real arm does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TypeVar

from adaptsim_cli.screen.release import Release, digest_of, grasping
from hw.ports import Arm, ArmWrapper, Hand
from hw.types import Execution, HandState, JointPath

Inner = TypeVar("Inner", bound=Arm)


class ReleasedArm(ArmWrapper[Inner]):
    """`hw.ports.Arm`: a motion begins only if `release` lets it. Each motion may raise StoppedByOperator."""

    def __init__(self, arm: Inner, release: Release) -> None:
        super().__init__(arm)
        self._release = release

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`."""
        self._begin(path)
        return self._arm.execute(path)

    def _begin(self, path: JointPath) -> None:
        self._release.take(path.digest, duration_s=path.duration_s)
        self._release.begun()


class ReleasedHand:
    """`hw.ports.Hand`: its fingers move only as `release` lets them. Each motion may raise StoppedByOperator."""

    def __init__(
        self,
        hand: Hand,
        release: Release,
        enabled: Callable[[str], None] = lambda _: None,
        moving: Callable[[], AbstractContextManager[None]] = nullcontext,
    ) -> None:
        """`enabled` waits for the pedal of a real hand, and is given the word "hand". Raises MotionRefused.

        `moving` is entered for every motion of the fingers.
        """
        self._hand, self._release, self._enabled, self._moving = hand, release, enabled, moving

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
        with self._begun(digest_of("home"), "homes its hand: the fingers open and close"):
            self._hand.home()

    def move(self, width_m: float) -> None:
        """See `hw.ports.Hand`."""
        with self._begun(digest_of("move", width_m), f"moves its fingers to {1e3 * width_m:.0f} mm"):
            self._hand.move(width_m)

    def grasp(self, width_m: float, force_N: float) -> None:
        """See `hw.ports.Hand`."""
        with self._begun(grasping(width_m, force_N), f"closes its hand with {force_N:.0f} N"):
            self._hand.grasp(width_m, force_N)

    @contextmanager
    def _begun(self, digest: str, what: str) -> Iterator[None]:
        self._release.take(digest, what)
        self._enabled("hand")
        self._release.begun()
        with self._moving():
            yield
