"""How each SDK drives a motion: the maker's `pylibfranka` the FR3, `panda_py` (libfranka 0.9.2) the Panda."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hw.franka.driver import SdkState, Step

NO_FILTER_HZ = 1000.0
"""libfranka's `kMaxCutoffFrequency`: the path is played as it was checked.

libfranka's rate limiter is off for the same reason. It would turn a jump of the commands into a chase at full speed
(`limitRate` in its rate_limiting.cpp); without it the arm refuses the jump.
"""

Drive = Callable[[Any, Any, Step], None]
"""(SDK module, its Robot, step): call `step` every millisecond until it marks its joints as the last."""


def drive_fr3(sdk: Any, robot: Any, step: Step) -> None:
    """Read a state, write its joints, a thousand times a second."""
    control = robot.start_joint_position_control(sdk.ControllerMode.JointImpedance)
    finished = False
    while not finished:
        state, since = control.readOnce()
        q_rad, finished = step(state, since.to_sec())
        command = sdk.JointPositions(q_rad)
        command.motion_finished = finished
        control.writeOnce(command)


def drive_panda(sdk: Any, robot: Any, step: Step) -> None:
    """The SDK calls back a thousand times a second."""

    def cycle(state: SdkState, since: Any) -> Any:
        q_rad, finished = step(state, since.to_sec())
        command = sdk.JointPositions(q_rad)
        command.motion_finished = finished
        return command

    robot.control_joint_position(
        cycle, controller_mode=sdk.ControllerMode.kJointImpedance, limit_rate=False, cutoff_frequency=NO_FILTER_HZ
    )


DRIVES: dict[str, Drive] = {"fr3": drive_fr3, "panda": drive_panda}
