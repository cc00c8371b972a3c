"""`adaptsim.lerobot` with LeRobot itself: a robot class of our own, found by its type, and the types that ship."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import adaptsim

pytestmark = pytest.mark.extra


def two_joints() -> Any:
    """The class of a robot with two joints that turn at most 4 units a command; registered as `two_joints`."""
    from lerobot.robots import Robot, RobotConfig  # noqa: PLC0415 - collected without the extra too

    @RobotConfig.register_subclass("two_joints")
    @dataclass(kw_only=True)
    class TwoJointsConfig(RobotConfig):  # type: ignore[misc]
        port: str
        max_relative_target: float = 4.0

    class TwoJoints(Robot):  # type: ignore[misc]
        config_class = TwoJointsConfig
        name = "two_joints"
        made: Any = None

        def __init__(self, config: Any) -> None:
            super().__init__(config)
            self.config, self.joints, self._on = config, {"a.pos": 0.0, "b.pos": 0.0}, False
            self.sent = list[tuple[float, dict[str, float]]]()
            TwoJoints.made = self

        observation_features = property(lambda self: {**dict.fromkeys(self.joints, float), "front": (4, 4, 3)})
        action_features = property(lambda self: dict.fromkeys(self.joints, float))
        is_connected = property(lambda self: self._on)
        is_calibrated = property(lambda self: True)

        def connect(self, calibrate: bool = True) -> None:
            self._on = True

        def disconnect(self) -> None:
            self._on = False

        def calibrate(self) -> None:
            raise AssertionError("it is calibrated")

        def configure(self) -> None:
            """Nothing to set."""

        def get_observation(self) -> dict[str, Any]:
            return {**self.joints, "front": np.zeros((4, 4, 3), np.uint8)}

        def send_action(self, action: dict[str, float]) -> dict[str, float]:
            most = self.config.max_relative_target
            self.joints = {n: v + float(np.clip(action[n] - v, -most, most)) for n, v in self.joints.items()}
            self.sent.append((time.monotonic(), dict(action)))
            return self.joints

    return TwoJoints


def test_a_robot_named_by_its_type_plays_a_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    from lerobot.robots import utils  # noqa: PLC0415

    robot_class = two_joints()
    monkeypatch.setattr(utils, "make_device_from_device_class", robot_class)  # its module has not LeRobot's layout

    def motion(trial: Any) -> list[dict[str, float]]:
        angles = np.linspace(0.0, 10.0 + trial.action["yaw"], 25)
        return [{"a.pos": float(angle), "b.pos": -5.0} for angle in angles]

    def report(trial: Any, played: Any) -> dict[str, Any]:
        assert played.joints["a.pos"][-1] > 8.0 and played.joints["b.pos"][-1] == pytest.approx(-5.0)
        far = trial.action["speed"] ** 2 / (2 * 9.81 * 0.12)
        return {"end": [0.56 + far, far * trial.action["yaw"], 0.035], "outcome": "upright"}

    session = adaptsim.begin("pushing", hw="own", name="arm")
    with adaptsim.lerobot("two_joints", motion, report, port="/dev/none", id="left") as player:
        assert session.run(1, robot=player) is session
    assert len(session.trials) == 4 and len(session.iterations) == 1
    robot = robot_class.made
    assert not robot.is_connected and len(robot.sent) == 4 * (150 + 25)
    spacing_s = np.diff([at for at, _ in robot.sent[150:175]])
    assert np.median(spacing_s) == pytest.approx(0.02, abs=0.002)


def test_types_that_ship_are_found_and_wrong_ones_named(tmp_path: Path) -> None:
    folder = {"calibration_dir": tmp_path}
    for kind in ("so101_follower", "koch_follower"):
        try:
            adaptsim.lerobot(kind, list, dict, port="/dev/none", id="left", **folder)
        except ImportError as error:  # the motors' own package, which LeRobot names itself
            assert "install" in str(error)
    with pytest.raises(
        adaptsim.UsageError, match=r'LeRobot has no robot "so101_folower": .*did you mean so101_follower'
    ):
        adaptsim.lerobot("so101_folower", list, dict)
    with pytest.raises(adaptsim.UsageError, match=r"the settings of so101_follower are not right: .*port"):
        adaptsim.lerobot("so101_follower", list, dict)
