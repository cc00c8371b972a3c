"""The bounds before a motion have safe ranges and are measured on the arm; a small change of held joints fades."""

from __future__ import annotations

import numpy as np
import pytest
from cells import READY, cell, move
from fr3_process import fr3
from players import SETTINGS, ReportedState, driver_of
from sdk_fake import FakeSdk

from adaptsim_cli.bench.rig_file.description import ArmPart, StartingPart
from hw.franka.driver import UNMOVED, Failure
from hw.franka.playback import FADE_TICKS, STEP_RAD, Playback, Played, motion_of
from hw.franka.process import rehearse
from hw.franka.settings import FrankaSettings
from hw.franka.starting import (
    HELD_RAD,
    HELD_RANGE_RAD,
    START_RANGE_S,
    UNWATCHED_RANGE_S,
    Rehearsal,
    Starting,
    proposed,
)
from hw.joint_limits import LIMITS, derivatives

PATH = move(np.full(7, 0.1), 1.0)


@pytest.mark.parametrize(
    ("name", "safe"),
    [("unwatched_s", UNWATCHED_RANGE_S), ("start_s", START_RANGE_S), ("held_rad", HELD_RANGE_RAD)],
)
def test_each_bound_has_a_safe_range_in_rig_file_and_settings(name: str, safe: tuple[float, float]) -> None:
    low, high = safe
    for value in safe:
        part = ArmPart("fr3", "172.16.0.2", starting=StartingPart(**{name: value}))
        assert getattr(part.settings().starting, name) == value
    for value in (0.99 * low, 1.01 * high):
        with pytest.raises(ValueError):
            Starting(**{name: value})
        with pytest.raises(ValueError):
            StartingPart(**{name: value})
    assert low < getattr(Starting(), name) < high


def played(
    off_rad: float, held_rad: float = HELD_RAD, stop_at: int = -1, model: str = "panda"
) -> tuple[Playback, Played]:
    """A motion whose arm holds joint 3 so far from the first sample."""
    held = READY + off_rad * np.eye(7)[2]
    cycle = 0
    playback = Playback(
        motion_of(PATH, cell(model).motion),
        lambda: "pedal" if 0 <= stop_at <= cycle else "",
        lambda: 0.0,
        start_s=600.0,
        held_rad=held_rad,
    )
    q, finished = held.tolist(), False
    before = q
    while not finished:
        dq = (np.array(q) - before) * 1e3
        before, state = q, ReportedState(q, dq.tolist(), q)
        q, finished = playback.step(state, 0.001 if cycle else 0.0)
        cycle += 1
    return playback, playback.played()


@pytest.mark.parametrize("model", sorted(LIMITS))
@pytest.mark.parametrize("stop_at", [-1, 0, 40, 300, 700])
def test_the_largest_difference_fades_within_the_limits_also_in_a_stop(model: str, stop_at: int) -> None:
    off_rad = 0.9 * HELD_RANGE_RAD[1]
    _, log = played(off_rad, HELD_RANGE_RAD[1], stop_at, model)
    _, plain = played(0.0, HELD_RANGE_RAD[1], stop_at, model)
    q = log.q_commanded_rad
    assert q[0, 2] == pytest.approx(READY[2] + off_rad, abs=1e-12), "no step at the beginning"
    assert len(q) > FADE_TICKS
    np.testing.assert_allclose(q[-1], plain.q_commanded_rad[-1], atol=1e-12)
    n = min(len(q), len(plain.q_commanded_rad))
    assert np.abs(q[:n] - plain.q_commanded_rad[:n]).max() <= off_rad + 1e-12
    dq, ddq, dddq = derivatives(q)
    limits = LIMITS[model]
    assert limits.ratios(np.concatenate([q, np.repeat(q[-1:], 3, axis=0)]), dq, ddq).max() <= 1.0
    assert (np.abs(dddq) / limits.dddq_max_rad_s3).max() <= 1.0


def test_a_rounding_of_the_state_is_no_difference_and_a_larger_one_than_the_bound_is_refused() -> None:
    _, log = played(0.9 * STEP_RAD)
    np.testing.assert_array_equal(log.q_commanded_rad[: len(PATH.q_rad)], PATH.q_rad)
    playback, log = played(1.1 * HELD_RAD)
    assert len(log.q_commanded_rad) == 0
    assert "it holds joint 3 3.3e-05 rad from the beginning (at most 3e-05 rad)" in playback.refused


def test_a_bound_is_proposed_with_room_to_spare_or_not_at_all() -> None:
    assert proposed(0.21, UNWATCHED_RANGE_S) == pytest.approx(0.32)
    assert proposed(0.01, UNWATCHED_RANGE_S) == UNWATCHED_RANGE_S[0]
    assert proposed(0.333, UNWATCHED_RANGE_S) == 0.5
    assert proposed(0.34, UNWATCHED_RANGE_S) is None
    assert proposed(2.1e-5, HELD_RANGE_RAD) == pytest.approx(3.2e-5)


class Slow(FakeSdk):
    """An arm whose answer to a setting takes its time, and whose held joints wander."""

    answer_s, wander_rad = 0.0, 0.0

    def Robot(self, host: str, realtime: str):
        robot = super().Robot(host, realtime)
        slow, state, sdk = robot.set_joint_impedance, robot._state, self

        def answered(stiffness: list[float]) -> None:
            slow(stiffness)
            sdk.idle(sdk.answer_s)

        def wandering():
            one = state()
            one.q_d = (np.array(one.q_d) + sdk.wander_rad * np.sin(20.0 * sdk.now_s)).tolist()
            return one

        vars(robot).update(set_joint_impedance=answered, _state=wandering)
        return robot


def test_a_rehearsal_measures_the_longest_pause_and_the_wander_and_moves_nothing() -> None:
    sdk = Slow(k=False)
    driver = driver_of(sdk, "fr3")
    quick = driver.rehearse(10, 3000)
    assert quick.starts == 10
    assert quick.pause_s < 0.002
    assert quick.wander_rad == 0.0
    sdk.answer_s, sdk.wander_rad = 0.12, 1e-5
    slow = driver.rehearse(10, 3000)
    assert 0.06 < slow.pause_s < 0.13
    assert slow.took_s > 0.12
    assert slow.wander_rad == pytest.approx(2e-5, rel=1e-2)
    assert slow.rest_s == 3.0
    assert not [name for name, _ in sdk.calls if name in ("start_joint_position_control", "command")]
    sdk.modes.pressed = True
    with pytest.raises(Failure, match="stop button") as refused:
        driver.rehearse(1, 10)
    assert refused.value.kind == UNMOVED


def test_a_slow_answer_is_a_pause_of_its_own_and_not_added_to_the_next() -> None:
    sdk = Slow(k=False)
    driver = driver_of(sdk, "fr3")
    sdk.answer_s = 0.15
    driver.prepare(driver.reading().at_s)
    sdk.answer_s = 0.4  # the socket keeps 64 ms of it
    with pytest.raises(Failure, match=r"nobody read the arm's state .* adaptsim doctor --measure proposes"):
        driver.prepare(driver.reading().at_s)
    patient = FrankaSettings(SETTINGS.host, starting=Starting(unwatched_s=0.4))
    driver = driver_of(sdk, "fr3", patient)
    driver.prepare(driver.reading().at_s)


@pytest.mark.long
def test_the_rehearsal_runs_over_the_makers_protocol() -> None:
    with fr3(pace="exact") as server:
        found = rehearse("fr3", FrankaSettings(server.host), realtime=False, starts=3, readings=300)
    assert isinstance(found, Rehearsal)
    assert 0.0 < found.pause_s < found.took_s
    assert found.wander_rad < HELD_RAD
