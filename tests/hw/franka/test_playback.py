"""A motion cycle by cycle, with an arm that follows at once."""

from __future__ import annotations

import numpy as np
import pytest
from cells import cell, move
from players import ReportedState

from hw.braking import brake
from hw.errors import MotionRefused
from hw.franka.motions import stop_report
from hw.franka.playback import HOLD_S, STILL_CYCLES, PlayableMotion, Playback, Played, motion_of
from hw.joint_limits import LIMITS, derivatives
from hw.types import JointPath

CHANGE = 0.55 * np.array([0.5, -0.3, 0.4, 0.2, 0.5, 0.3, -0.5])


def path(duration_s: float = 1.0) -> JointPath:
    return move(CHANGE, duration_s)


def play(
    motion: PlayableMotion, stop_at_tick: int = -1, lost: dict[int, int] | None = None, restless: bool = False
) -> Played:
    """`lost` maps a cycle to how many before it were lost."""
    tick, cycle = 0, 0

    def wanted() -> str:
        return "pedal" if 0 <= stop_at_tick <= tick else ""

    playback, state, finished = Playback(motion, wanted, lambda: 100.0 + tick / 1000), ReportedState(), False
    while not finished:
        ticks = 0 if cycle == 0 else 1 + (lost or {}).get(cycle, 0)
        tick, cycle = tick + ticks, cycle + 1
        q, finished = playback.step(state, ticks / 1000)
        dq = (np.array(q) - state.q) / (max(ticks, 1) / 1000)
        state = ReportedState(q, np.full(7, 1.0).tolist() if restless else dq.tolist())
    return playback.played()


def test_every_sample_is_commanded_in_its_millisecond_and_the_end_is_held_until_standstill() -> None:
    played = play(motion_of(path(), cell("panda").motion))
    np.testing.assert_array_equal(played.q_commanded_rad[:1001], path().q_rad)
    assert (played.q_commanded_rad[1001:] == path().q_rad[-1]).all()
    assert len(played.t_s) - 1000 == STILL_CYCLES  # the last sample of the path is the first of them
    assert played.success_rate == 1.0
    assert stop_report(played) is None


def test_an_arm_that_does_not_come_to_rest_is_not_waited_for_forever() -> None:
    played = play(motion_of(path(), cell("panda").motion), restless=True)
    assert played.t_s[-1] == pytest.approx(1.0 + HOLD_S)


def test_a_lost_cycle_is_skipped_not_repeated_and_is_counted() -> None:
    played = play(motion_of(path(), cell("panda").motion), lost={200: 1, 500: 2})
    due = np.rint(played.t_s * 1000).astype(int)
    np.testing.assert_array_equal(np.diff(due)[[199, 499]], [2, 3])
    np.testing.assert_array_equal(played.q_commanded_rad, path().q_rad[np.minimum(due, 1000)])
    assert played.answered == pytest.approx(1.0 - 3 / (due[-1] + 1))


@pytest.mark.parametrize("model", ["panda", "fr3"])
@pytest.mark.parametrize("at", [0, 3, 137, 499, 500, 612, 871, 960])
def test_a_stop_is_that_of_hw_braking_within_ten_milliseconds_and_the_limits(model: str, at: int) -> None:
    motion = motion_of(path(), cell(model).motion)
    played = play(motion, stop_at_tick=at)
    begins = int(motion.stop_at[np.searchsorted(motion.stop_at, at + 1)])
    assert at < begins <= at + 11
    expected = brake(path(), begins / 1000, cell(model).motion).q_rad
    np.testing.assert_allclose(played.q_commanded_rad[: len(expected)], expected, atol=1e-12)
    dq, ddq, dddq = derivatives(played.q_commanded_rad)
    q = np.concatenate([played.q_commanded_rad, np.repeat(played.q_commanded_rad[-1:], 3, axis=0)])
    assert LIMITS[model].ratios(q, dq, ddq).max() <= 1.0
    assert (np.abs(dddq) / LIMITS[model].dddq_max_rad_s3).max() <= 1.0
    report = stop_report(played)
    assert report is not None
    assert report.why == "pedal"
    assert report.braked_clock_s == pytest.approx(100.0 + (begins + 1) / 1000)
    assert report.at_s == pytest.approx(at / 1000)
    assert report.braking_after_s == pytest.approx((begins + 1 - at) / 1000)


def test_a_stop_after_the_last_moment_to_brake_lets_the_path_end() -> None:
    played = play(motion_of(path(), cell("panda").motion), stop_at_tick=1000)
    np.testing.assert_array_equal(played.q_commanded_rad[-1], path().q_rad[-1])
    assert stop_report(played) is None


def test_a_stop_during_lost_cycles_still_comes_to_rest_on_the_path() -> None:
    played = play(motion_of(path(), cell("panda").motion), stop_at_tick=400, lost=dict.fromkeys(range(390, 420, 3), 2))
    off = np.abs(path().q_rad[None] - played.q_commanded_rad[:, None]).max(axis=2).min(axis=1)
    assert off.max() < 2e-3
    np.testing.assert_array_equal(played.q_commanded_rad[-1], played.q_commanded_rad[-STILL_CYCLES])


def test_the_way_and_time_to_standstill_are_measured_not_planned() -> None:
    report = stop_report(play(motion_of(path(), cell("panda").motion), stop_at_tick=500))
    assert report is not None
    assert 0.02 < report.still_after_s < 0.3
    assert 0.005 < report.way_m < 0.1
    assert "braking began after" in str(report)


def test_a_path_without_stops_is_refused() -> None:
    with pytest.raises(MotionRefused, match="no stop"):
        motion_of(path(0.3), cell("panda").motion)
