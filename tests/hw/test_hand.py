"""What every hand does: the fake one, the lab's, and the real one over an SDK with a gripper inside."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from hw.errors import DeviceUnavailable, HandError
from hw.fake import FakeHand
from hw.franka.hand import FrankaHand
from hw.ports import Hand
from sim.lab.hand import Grip, LabHand

HANDLE_M = 0.012


@dataclass
class Gripper:
    """The SDK's gripper: returns False where it did not do it, raises where it stopped."""

    between_m: float | None
    width: float = 0.08
    max_width: float = 0.08
    is_grasped: bool = False
    broken: str = ""

    def _work(self) -> None:
        if self.broken:
            raise RuntimeError(self.broken)

    def homing(self) -> bool:
        self._work()
        return self.between_m is None

    def move(self, width: float, speed: float) -> bool:
        self._work()
        assert 0.0 < speed <= 0.05
        self.width, self.is_grasped = max(width, self.between_m or 0.0), False
        return True

    def grasp(self, width: float, speed: float, force: float, epsilon_inner: float, epsilon_outer: float) -> bool:
        self._work()
        self.width = self.between_m or 0.0
        self.is_grasped = width - epsilon_inner <= self.width <= width + epsilon_outer
        return self.is_grasped

    def read_once(self) -> Any:
        self._work()
        return SimpleNamespace(width=self.width, max_width=self.max_width, is_grasped=self.is_grasped)


def franka(between_m: float | None) -> FrankaHand:
    return FrankaHand("fr3.test", lambda: SimpleNamespace(Gripper=lambda host: Gripper(between_m)))


def lab(between_m: float | None) -> LabHand:
    return LabHand(Grip(between_m or HANDLE_M, offered=between_m is not None))


KINDS: dict[str, Callable[[float | None], Hand]] = {"fake": FakeHand, "lab": lab, "franka": franka}


@pytest.fixture(params=KINDS)
def make(request: pytest.FixtureRequest) -> Callable[[float | None], Hand]:
    return KINDS[request.param]


def offered(hand: Hand) -> None:
    """The tool comes between the fingers after homing."""
    match hand:
        case FakeHand():
            hand.between_m = HANDLE_M
        case LabHand():
            hand._grip.offered = True
        case FrankaHand():
            hand._gripper.between_m = HANDLE_M


def test_a_hand_must_be_entered(make: Callable[[float | None], Hand]) -> None:
    hand = make(None)
    for use in (hand.state, hand.home, lambda: hand.move(0.05), lambda: hand.grasp(HANDLE_M, 40.0)):
        with pytest.raises(DeviceUnavailable):
            use()


def test_nothing_before_homing(make: Callable[[float | None], Hand]) -> None:
    with make(None) as hand:
        assert not hand.state().homed
        for use in (lambda: hand.move(0.05), lambda: hand.grasp(HANDLE_M, 40.0)):
            with pytest.raises(HandError, match="home it first"):
                use()


def test_homing_needs_an_empty_hand(make: Callable[[float | None], Hand]) -> None:
    with make(HANDLE_M) as hand, pytest.raises(HandError, match=r"take (it|everything) out"):
        hand.home()


def test_it_opens_closes_and_holds(make: Callable[[float | None], Hand]) -> None:
    with make(None) as hand:
        hand.home()
        hand.move(0.06)
        assert hand.state().width_m == pytest.approx(0.06)
        offered(hand)
        hand.grasp(HANDLE_M, 40.0)
        state = hand.state()
        assert (state.holds, state.homed) == (True, True)
        assert state.width_m == pytest.approx(HANDLE_M)


def test_what_it_refuses(make: Callable[[float | None], Hand]) -> None:
    with make(None) as hand:
        hand.home()
        with pytest.raises(HandError, match="0 to 80"):
            hand.move(0.09)
        with pytest.raises(HandError, match="up to 70 N"):
            hand.grasp(HANDLE_M, 90.0)
        with pytest.raises(HandError, match=r"12\.0 mm"):
            hand.grasp(HANDLE_M, 40.0)  # nothing is there
        assert not hand.state().holds
        offered(hand)
        with pytest.raises(HandError, match="grasp it"):
            hand.move(0.005)


@pytest.mark.parametrize("width_m", [0.002, 0.005])
def test_a_thin_handle_that_is_not_there_is_not_held(make: Callable[[float | None], Hand], width_m: float) -> None:
    with make(None) as hand:
        hand.home()
        with pytest.raises(HandError):
            hand.grasp(width_m, 40.0)
        assert not hand.state().holds


def test_a_gripper_that_stops_or_falls_silent_is_said() -> None:
    with franka(None) as hand:
        hand.home()
        hand._gripper.broken = "libfranka gripper: command failed"
        with pytest.raises(HandError, match="command failed"):
            hand.grasp(HANDLE_M, 40.0)
        with pytest.raises(DeviceUnavailable, match="does not answer any more"):
            hand.state()


def test_a_hand_that_is_not_there_is_said() -> None:
    def refuse(host: str) -> Any:
        raise RuntimeError(f"connection to {host} refused")

    with pytest.raises(DeviceUnavailable, match=r"fr3\.test.*initialised in Desk"):
        FrankaHand("fr3.test", lambda: SimpleNamespace(Gripper=refuse)).__enter__()
