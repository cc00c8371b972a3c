"""The interface of a lab, real or simulated: its description, known without any device, and its devices."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from adaptsim_cli.bench.calibration.parts import BoardHandler
from adaptsim_cli.bench.devices.known_arm import StopMeasurement
from adaptsim_cli.bench.devices.mounted import MountedTask
from adaptsim_cli.bench.rig import Rig
from adaptsim_cli.bench.rig_file.description import RigDescription
from adaptsim_cli.bench.touch_off.parts import PersonAtTool
from adaptsim_cli.screen.release import Release
from calib.types import HandEye
from hw.collision import KeepOut, Tool
from hw.ports import Arm, Camera, Hand
from hw.types import Array
from hw.workcell import Workcell

if TYPE_CHECKING:
    from hw.franka.motions import StopReport
    from hw.franka.settings import Payload
    from sim.lab.board import HeldBoard


BoardDevices = tuple[Arm, Camera, Callable[[float], None], BoardHandler | None, Release]
"""Arm and camera, connected, with the board in the gripper; the camera's frames have an infrared image. The third
element pauses for so many seconds, except in the simulated lab. The fourth handles the board; it is None if a person at
the terminal does. The last one asks the questions that let the arm move."""

TouchDevices = tuple[Arm, Hand | None, Callable[[float], None], PersonAtTool | None, Release]
"""The arm, connected, and the hand that holds its tool, or None if the tool is screwed on. The third element pauses for
so many seconds, except in the simulated lab. The fourth guides the arm; it is None if a person at the terminal does.
The last one asks the questions that let the hand move."""


class Lab(Protocol):
    """A lab during one command. Opening it moves nothing; each `for_...` may raise DeviceUnavailable."""

    @property
    def rig(self) -> RigDescription:
        """The content of the rig file; the simulated lab has one too."""

    @property
    def title(self) -> str:
        """Its name for an operator."""

    @property
    def nominal(self) -> HandEye | None:
        """The camera's pose before any calibration; None: unknown."""

    def boxes_around_camera(self, X_BC: Array) -> tuple[KeepOut, ...]:
        """Further keep-out boxes for trials, with the camera at X_BC (4, 4)."""

    def note(self, message: str) -> None:
        """Show a message to the person beside the arm, if there is one."""

    def for_trials(self, mounted_task: MountedTask, hand_eye: HandEye, days: int) -> Rig:
        """Devices for trials.

        `hand_eye` is the camera's pose over the table; a calibration older than `days` gives a warning.
        """

    def for_calibration(self, held: HeldBoard, cell: Workcell, home_rad: Array) -> BoardDevices:
        """Arm and camera, connected, with `held` in the gripper; `cell` decides which motions are allowed."""

    def for_touch_off(self, cell: Workcell) -> TouchDevices:
        """The devices of a touch-off; `cell` includes the tool. The arm does not move by itself."""

    def measure_stop(self, mounted_task: MountedTask) -> StopMeasurement:
        """Have the stop button pressed during a slow swing. Store the time and the distance until rest, beside those of
        the worst case.

        Raises StoppedByOperator, MotionRefused, HardwareError.
        """


class RealArm(Arm, Protocol):
    """The arm of a lab, which has to know the load in its hand."""

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for each real-time property that the computer denies to the arm's process; known once it is
        connected.
        """

    @property
    def last_stop(self) -> StopReport | None:
        """How the arm's last motion stopped; None if it was completed."""

    def carry(self, tool: Tool, payload: Payload) -> None:
        """Set the load, for the checks and for the arm's weight compensation. Nothing moves. Raises HardwareError."""
