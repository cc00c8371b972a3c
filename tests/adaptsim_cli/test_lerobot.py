"""A robot of LeRobot, by a stand-in; tests/extras/test_lerobot_robots.py has LeRobot's own base class."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import adaptsim
from adaptsim_cli.api.lerobot import APPROACH_S, RATE_HZ, LeRobotPlayer

JOINTS = ("shoulder.pos", "wrist.pos")


class Clock:
    """Time goes on while somebody sleeps, and by 1 ms with each command."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        assert duration_s >= 0.0
        self.now_s += duration_s


class StandIn:
    """Follows each target at once; it has a camera too."""

    action_features = dict.fromkeys(JOINTS, float)

    def __init__(self, clock: Clock) -> None:
        self.clock, self.joints, self.sent = clock, dict.fromkeys(JOINTS, 10.0), list[tuple[float, dict[str, float]]]()
        self.connected = False

    def connect(self) -> None:
        self.connected = True

    def disconnect(self) -> None:
        self.connected = False

    def get_observation(self) -> dict[str, Any]:
        return {**self.joints, "front": np.zeros((4, 4, 3))}

    def send_action(self, action: Mapping[str, float]) -> None:
        assert self.connected
        self.clock.now_s += 0.001
        self.sent.append((self.clock.now_s, dict(action)))
        self.joints.update(action)


def swing(trial: Any) -> list[dict[str, float]]:
    return [{"shoulder.pos": 20.0 + k, "wrist.pos": -trial.action["yaw"]} for k in range(5)]


def test_a_session_is_played_at_50_hz_and_reported(place: Any) -> None:
    clock = Clock()
    robot, seen = StandIn(clock), []

    def report(trial: Any, played: Any) -> dict[str, Any]:
        seen.append(played)
        far = trial.action["speed"] ** 2 / (2 * 9.81 * 0.12)
        return {"end": [0.56 + far, far * trial.action["yaw"], 0.035], "outcome": "upright"}

    session = adaptsim.begin("pushing", hw="own")
    trial = session.ask()
    with LeRobotPlayer(robot, swing, report, clock, clock.sleep) as player:
        session.tell(trial, **player(trial))
        assert robot.connected
    assert not robot.connected
    approach = round(APPROACH_S * RATE_HZ)
    assert len(robot.sent) == approach + 5
    assert np.allclose(np.diff([at for at, _ in robot.sent[approach:]]), 1 / RATE_HZ)
    way = [row["shoulder.pos"] for _, row in robot.sent[:approach]]
    assert way[0] == 10.0 and way[-1] == 20.0 and max(np.diff(way)) < 0.1, "slowly, from the present joints"
    (played,) = seen
    assert set(played.joints) == set(JOINTS), "pictures are no joints"
    assert played.joints["shoulder.pos"].tolist() == [20.0, 20.0, 21.0, 22.0, 23.0], "just before each target"
    assert np.allclose(played.t_s, np.arange(5) / RATE_HZ)
    assert session.ask().trial == 2


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([], "gave no joint targets"),
        ([{"shoulder.pos": 1.0}], "row 0 of the joint targets has shoulder.pos; this robot has "),
        ([dict.fromkeys(JOINTS, float("nan"))], "a value that is not a number"),
    ],
)
def test_targets_that_the_robot_does_not_have_are_refused_before_it_moves(rows: Any, said: str) -> None:
    clock = Clock()
    robot = StandIn(clock)
    player = LeRobotPlayer(robot, lambda trial: rows, lambda *_: {}, clock, clock.sleep)
    with player, pytest.raises(adaptsim.UsageError, match=said):
        player(object())  # type: ignore[arg-type]
    assert robot.sent == []


def test_without_lerobot_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lerobot", None)
    with pytest.raises(adaptsim.ExtraMissing, match=r"needs the package lerobot, .*\[lerobot\]"):
        adaptsim.lerobot("so101_follower", swing, dict, port="/dev/ttyACM0")
