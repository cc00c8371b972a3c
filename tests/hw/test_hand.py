"""What the Franka Hand's driver adds to the contract of a hand: an SDK that fails in its own words."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from hands import HANDLE_M, FrankaException, fr3_sdk, panda_sdk

from hw.errors import DeviceUnavailable, HandError
from hw.franka.hand import FrankaHand, Sdk


@pytest.mark.parametrize("sdk", [panda_sdk, fr3_sdk])
def test_a_gripper_that_stops_or_falls_silent_is_said(sdk: Callable[[float | None], Sdk]) -> None:
    with FrankaHand("arm.test", sdk(None)) as hand:
        hand.home()
        hand._gripper.broken = "libfranka gripper: command failed"
        with pytest.raises(HandError, match="command failed"):
            hand.grasp(HANDLE_M, 40.0)
        with pytest.raises(DeviceUnavailable, match="answers"):
            hand.state()


@pytest.mark.parametrize("error", [RuntimeError, FrankaException])
def test_a_hand_that_is_not_there_is_said(error: type[Exception]) -> None:
    def refuse(host: str) -> Any:
        raise error(f"connection to {host} refused")

    with pytest.raises(DeviceUnavailable, match=r"fr3\.test.*activate FCI in Desk"):
        FrankaHand("fr3.test", lambda: SimpleNamespace(Gripper=refuse, FrankaException=FrankaException)).__enter__()
