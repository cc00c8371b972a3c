"""How a motion of the FR3 is driven through `pylibfranka`, the maker's own SDK."""

from __future__ import annotations

from typing import Any

from hw.franka.driver import Step


def drive(sdk: Any, robot: Any, step: Step) -> None:
    """`hw.franka.connection.Drive`: read a state, write its joints, a thousand times a second."""
    control = robot.start_joint_position_control(sdk.ControllerMode.JointImpedance)
    finished = False
    while not finished:
        state, since = control.readOnce()
        q_rad, finished = step(state, since.to_sec())
        command = sdk.JointPositions(q_rad)
        command.motion_finished = finished
        control.writeOnce(command)
