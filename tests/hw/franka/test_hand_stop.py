"""What is said of a stop follows from the widths around it, never from the stop's answer."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from hw.franka.hand_stop import COAST_M, WATCH_S, Stopped, Widths, stopped

SPEED_M_S = 0.03


@dataclass
class Hand:
    """Fingers in simulated time that close until a stop is obeyed; `obeys` is the number of the stop that they obey."""

    obeys: int = 1
    width_m: float = 0.06
    coast_s: float = 0.03
    answers_after_s: float = 0.02
    now_s: float = 0.0
    stops: int = 0
    stops_at_s: float = 1e9
    rows: list[tuple[float, float]] = field(default_factory=list)
    silent: bool = False

    def pass_s(self, seconds: float) -> None:
        for _ in range(round(100.0 * seconds)):
            self.now_s += 0.01
            if self.now_s < self.stops_at_s:
                self.width_m = max(self.width_m - 0.01 * SPEED_M_S, 0.0)
            self.rows.append((self.now_s, self.width_m))

    def stop(self) -> None:
        self.stops += 1
        if self.stops == self.obeys:
            self.stops_at_s = self.now_s + self.coast_s
        self.pass_s(self.answers_after_s)

    def read(self, for_s: float) -> Widths:
        self.pass_s(for_s)
        rows, self.rows = self.rows, []
        return () if self.silent else rows

    def stopped(self) -> Stopped:
        self.pass_s(0.5)
        return stopped("pedal", self.stop, self, lambda: self.now_s, lambda: None)


def test_fingers_that_stand_where_the_stop_found_them_were_stopped() -> None:
    hand = Hand()
    outcome = hand.stopped()
    assert outcome.is_certain
    assert (outcome.stops, hand.stops) == (1, 1)
    assert outcome.from_m == pytest.approx(0.045)
    assert outcome.to_m == hand.width_m
    assert str(outcome.error()).startswith("the hand was stopped: the enabling pedal was released; look at it")


def test_fingers_that_obey_the_second_stop_are_told_with_both_widths() -> None:
    hand = Hand(obeys=2)
    outcome = hand.stopped()
    assert not outcome.is_certain
    assert outcome.stands
    assert hand.stops == 2
    assert "the hand was stopped" not in str(outcome.error())
    assert f"2 stops were accepted but the fingers still moved: 45.0 mm, then {1e3 * hand.width_m:.1f} mm" in str(
        outcome.error()
    )
    assert "where they stand now" in str(outcome.error())


def test_fingers_that_obey_no_stop_are_watched_until_they_arrive() -> None:
    hand = Hand(obeys=0)
    outcome = hand.stopped()
    assert hand.stops > 3
    assert outcome.to_m == hand.width_m == 0.0
    assert str(outcome.error()).startswith(
        f"{hand.stops} stops were accepted but the fingers still moved: 45.0 mm, then 0.0 mm"
    )
    assert "No motion follows without a recovery" in str(outcome.error())


def test_fingers_that_never_arrive_are_not_said_to_stand() -> None:
    hand = Hand(obeys=0, width_m=1.0)
    outcome = hand.stopped()
    assert hand.now_s < 0.5 + 2.0 * WATCH_S
    assert not outcome.stands
    assert "the fingers still move:" in str(outcome.error())
    assert "stand now" not in str(outcome.error())


def test_a_stop_that_is_answered_once_the_fingers_have_arrived_is_no_stop() -> None:
    hand = Hand(answers_after_s=0.8, obeys=0, width_m=0.03)
    outcome = hand.stopped()
    assert outcome.stands
    assert not outcome.is_certain
    assert "but the fingers still moved: 15.0 mm, then 0.0 mm, where they stand now" in str(outcome.error())


def test_a_width_that_cannot_be_read_leaves_the_stop_unknown() -> None:
    hand = Hand(silent=True)
    assert "nobody knows whether the fingers stand" in str(hand.stopped().error())
    assert not stopped("pedal", hand.stop, None, lambda: hand.now_s, lambda: None).is_certain


@pytest.mark.parametrize(("coast_m", "is_certain"), [(0.9 * COAST_M, True), (1.1 * COAST_M, False)])
def test_how_far_stopped_fingers_may_coast(coast_m: float, is_certain: bool) -> None:
    assert Hand(coast_s=coast_m / SPEED_M_S, answers_after_s=0.2).stopped().is_certain is is_certain
