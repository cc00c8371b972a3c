"""Every hand of the program: simulated ones, and the driver of the Franka Hand over stand-ins of both SDKs."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from hw.franka.hand import FrankaHand, Sdk
from hw.franka.versions import PACKAGES, load
from hw.grasping import FakeHand
from hw.ports import Hand

HANDLE_M = 0.012


class FrankaException(Exception):
    """pylibfranka's: no RuntimeError, unlike what panda_py raises."""


@dataclass
class Gripper:
    """The SDK's gripper: returns False where it did not do it, raises where it stopped."""

    between_m: float | None
    error: type[Exception] = RuntimeError
    width: float = 0.08
    max_width: float = 0.08
    is_grasped: bool = False
    broken: str = ""

    def _work(self) -> None:
        if self.broken:
            raise self.error(self.broken)

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
        if not self.is_grasped:  # a hand that found nothing may open again
            self.width = self.max_width
        return self.is_grasped

    def read_once(self) -> Any:
        self._work()
        return SimpleNamespace(width=self.width, max_width=self.max_width, is_grasped=self.is_grasped)


@dataclass(frozen=True)
class Grippers:
    """Hands whose fingers close on something of a given width, None: on nothing; and how a tool comes between them."""

    make: Callable[[float | None], Hand]
    offer: Callable[[Hand], None]


def panda_sdk(between_m: float | None) -> Sdk:
    return lambda: SimpleNamespace(Gripper=lambda host: Gripper(between_m))


def fr3_sdk(between_m: float | None) -> Sdk:
    return lambda: SimpleNamespace(
        Gripper=lambda host: Gripper(between_m, FrankaException), FrankaException=FrankaException
    )


def _offer_fake(hand: Any) -> None:
    hand.between_m = HANDLE_M


def _offer_franka(hand: Any) -> None:
    hand._gripper.between_m = HANDLE_M


def _real(between_m: float | None) -> Hand:
    """The empty hand of the arm at ADAPTSIM_TEST_FR3: its fingers move, so nobody may reach between them."""
    if between_m is not None:
        pytest.skip("nothing may lie between the fingers of a real hand")
    address = os.environ.get("ADAPTSIM_TEST_FR3")
    if not address:
        pytest.fail("say where the arm is: ADAPTSIM_TEST_FR3=172.16.0.2")
    return FrankaHand(address, lambda: load(PACKAGES["fr3"]))


def _offer_real(hand: Hand) -> None:
    pytest.skip("nobody holds a tool between the fingers of a real hand")


GRIPPERS = {
    "fake": Grippers(FakeHand, _offer_fake),
    "panda": Grippers(lambda between_m: FrankaHand("panda.test", panda_sdk(between_m)), _offer_franka),
    "fr3": Grippers(lambda between_m: FrankaHand("fr3.test", fr3_sdk(between_m)), _offer_franka),
}
REAL = Grippers(_real, _offer_real)
