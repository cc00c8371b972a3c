"""A gap between two cycles, or a jump of the joints, ends a motion in the player: no command follows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import nan
from typing import Any

import numpy as np
import pytest
from cells import READY, cell, move
from players import ReportedState, arm_of
from sdk_fake import Duration, FakeRobot, FakeSdk

from hw.errors import ArmFault
from hw.franka.driver import FAULT, Failure
from hw.franka.playback import GAP_S, Playback, motion_of
from hw.types import JointPath

MODELS = ["panda", "fr3"]
PATH = move([0.2, -0.1, 0.1, 0.0, 0.0, 0.0, 0.1], 1.5)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("since_s", "words"),
    [
        (lambda n: 1.0 if n == 300 else 0.001, r"1000 ms of the arm's clock passed between two cycles \(at most 20 ms"),
        (lambda n: 0.021 if n == 300 else 0.001, "21 ms of the arm's clock passed"),
        (lambda n: 0.0 if 300 <= n < 1500 else 0.001, r"went on by 0 ms .*has to advance"),
        (lambda n: -0.5 if n == 300 else 0.001, "went on by -500 ms"),
    ],
)
def test_after_a_gap_nothing_is_commanded_and_the_arm_needs_a_recovery(
    monkeypatch: pytest.MonkeyPatch, model: str, since_s: Callable[[int], float], words: str
) -> None:
    sdk = FakeSdk(k=model == "panda", q_rad=READY.tolist())

    def since(robot: FakeRobot) -> Duration:
        robot._cycle += 1
        return Duration(0.0 if robot._cycle == 1 else since_s(robot._cycle))

    with arm_of(sdk, model) as arm:
        monkeypatch.setattr(FakeRobot, "_since", since)
        with pytest.raises(
            ArmFault, match=rf"{model} stopped 0\.298 s into the path: .*{words}.*nothing was commanded"
        ):
            arm.execute(PATH)
        sent = np.array([q for name, (q, _) in (call for call in sdk.calls if call[0] == "command")])
        np.testing.assert_array_equal(sent, PATH.q_rad[:299])
        assert ("stop", None) in sdk.calls, "the SDK was told that the motion is over"
        assert arm.last_execution is not None
        assert len(arm.last_execution.t_s) == 299, "the log stands up to the gap"
        with pytest.raises(ArmFault, match="recover"):
            arm.execute(PATH)
        monkeypatch.undo()
        arm.recover()
        arm.execute(move([0.02] * 7, 0.6, start_rad=arm.state().q_rad))


@pytest.mark.parametrize("model", MODELS)
def test_a_gap_that_the_arm_bridges_goes_on(model: str) -> None:
    most = round(1000 * GAP_S)
    played = steps(model, lambda cycle: 0.001 * most if cycle == 200 else 0.001)
    assert played._tick >= 1500


@pytest.mark.parametrize("dt_s", [0.0206, 0.5, 0.0, -0.001, nan])
def test_the_time_between_two_cycles_has_its_bounds(dt_s: float) -> None:
    with pytest.raises(Failure, match="nothing was commanded") as raised:
        steps("panda", lambda cycle: dt_s if cycle == 40 else 0.001)
    assert raised.value.kind == FAULT


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("joint", range(7))
def test_a_step_that_no_joint_may_make_is_not_sent(model: str, joint: int) -> None:
    limits = cell(model).motion
    motion = motion_of(PATH, limits)
    most_rad = limits.joints.dq_max_rad_s[joint] * 0.001
    for share, ends in ((0.9, False), (1.1, True)):
        q_rad = PATH.q_rad.copy()
        q_rad[500:, joint] += share * most_rad - (q_rad[500, joint] - q_rad[499, joint])
        jumping = replace(motion, path=JointPath(PATH.t_s, q_rad))
        if not ends:
            steps(model, lambda cycle: 0.001, jumping)
            continue
        with pytest.raises(Failure, match=rf"joint {joint + 1} by .* rad in 1 ms .*it was not sent"):
            steps(model, lambda cycle: 0.001, jumping)


def steps(model: str, since_s: Callable[[int], float], motion: Any = None) -> Playback:
    """Plays on an arm that follows at once."""
    playback = Playback(motion or motion_of(PATH, cell(model).motion), lambda: "", lambda: 0.0, start_s=600.0)
    q, finished, cycle = READY.tolist(), False, 0
    while not finished:
        q, finished = playback.step(ReportedState(q, q_d=q), since_s(cycle) if cycle else 0.0)
        cycle += 1
    return playback
