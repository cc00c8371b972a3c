"""What every hand does: the fake one, the lab's, the Franka Hand's driver over both SDKs, and a real hand."""

from __future__ import annotations

import pytest
from hands import GRIPPERS, HANDLE_M, REAL, Grippers

from hw.errors import DeviceUnavailable, HandError


@pytest.fixture(
    params=[
        *(pytest.param(made, id=name) for name, made in GRIPPERS.items()),
        pytest.param(REAL, id="real", marks=pytest.mark.hardware),
    ]
)
def grippers(request: pytest.FixtureRequest) -> Grippers:
    made: Grippers = request.param
    return made


def test_it_serves_only_while_it_is_entered(grippers: Grippers) -> None:
    hand = grippers.make(None)
    for _ in range(2):  # before, and once it was left
        for use in (hand.state, hand.home, lambda: hand.move(0.05), lambda: hand.grasp(HANDLE_M, 40.0)):
            with pytest.raises(DeviceUnavailable, match="not connected"):
                use()
        with hand:
            hand.state()


def test_nothing_before_homing(grippers: Grippers) -> None:
    with grippers.make(None) as hand:
        assert not hand.state().homed
        before_m = hand.state().width_m
        for use in (lambda: hand.move(0.05), lambda: hand.grasp(HANDLE_M, 40.0)):
            with pytest.raises(HandError, match="home it first"):
                use()
        assert hand.state().width_m == pytest.approx(before_m, abs=1e-3)


def test_homing_needs_an_empty_hand(grippers: Grippers) -> None:
    with grippers.make(HANDLE_M) as hand:
        with pytest.raises(HandError, match=r"take (it|everything) out"):
            hand.home()
        assert not hand.state().homed


def test_it_goes_to_a_width_in_metres(grippers: Grippers) -> None:
    with grippers.make(None) as hand:
        hand.home()
        for width_m in (0.06, 0.0, 0.08):
            hand.move(width_m)
            state = hand.state()
            assert state.width_m == pytest.approx(width_m, abs=2e-3)
            assert (state.holds, state.homed) == (False, True)


def test_it_holds_what_it_grasps_until_it_opens(grippers: Grippers) -> None:
    with grippers.make(None) as hand:
        hand.home()
        hand.move(0.06)
        grippers.offer(hand)
        hand.grasp(HANDLE_M, 40.0)
        state = hand.state()
        assert (state.holds, state.homed) == (True, True)
        assert state.width_m == pytest.approx(HANDLE_M)
        hand.move(0.06)
        assert not hand.state().holds


@pytest.mark.parametrize("width_m", [-0.001, 0.09])
def test_a_width_beyond_its_travel_is_refused(grippers: Grippers, width_m: float) -> None:
    with grippers.make(None) as hand:
        hand.home()
        before_m = hand.state().width_m
        with pytest.raises(HandError, match=r"mm: the range is 0 to \d+"):
            hand.move(width_m)
        assert hand.state().width_m == pytest.approx(before_m, abs=1e-3)


@pytest.mark.parametrize("force_N", [-1.0, 0.0, 90.0])
def test_a_force_it_does_not_have_is_refused(grippers: Grippers, force_N: float) -> None:
    with grippers.make(None) as hand:
        hand.home()
        grippers.offer(hand)
        with pytest.raises(HandError, match="at most 70 N"):
            hand.grasp(HANDLE_M, force_N)
        assert not hand.state().holds


def test_moving_onto_something_is_an_error_and_no_grasp(grippers: Grippers) -> None:
    with grippers.make(None) as hand:
        hand.home()
        grippers.offer(hand)
        with pytest.raises(HandError, match="grasp it"):
            hand.move(0.005)
        assert not hand.state().holds


@pytest.mark.parametrize("width_m", [0.002, 0.005, HANDLE_M])
def test_a_handle_that_is_not_there_is_not_held(grippers: Grippers, width_m: float) -> None:
    with grippers.make(None) as hand:
        hand.home()
        with pytest.raises(HandError, match=f"{1e3 * width_m:.1f} mm"):
            hand.grasp(width_m, 40.0)
        assert not hand.state().holds
