"""How a motion of the Panda is driven through `panda_py.libfranka`, whose wheel brings libfranka 0.9.2."""

from __future__ import annotations

from typing import Any

from hw.franka.driver import SdkState, Step

NO_FILTER_HZ = 1000.0
"""libfranka's `kMaxCutoffFrequency`: the path is played as it was checked.

libfranka's rate limiter is off for the same reason. It would turn a jump of the commands into a chase at full speed
(`limitRate` in its rate_limiting.cpp); without it the arm refuses the jump.
"""


def drive(sdk: Any, robot: Any, step: Step) -> None:
    """`hw.franka.connection.Drive`: the SDK calls back a thousand times a second."""

    def cycle(state: SdkState, since: Any) -> Any:
        q_rad, finished = step(state, since.to_sec())
        command = sdk.JointPositions(q_rad)
        command.motion_finished = finished
        return command

    robot.control_joint_position(
        cycle, controller_mode=sdk.ControllerMode.kJointImpedance, limit_rate=False, cutoff_frequency=NO_FILTER_HZ
    )
