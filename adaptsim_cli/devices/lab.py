"""What a lab offers, real or simulated: what is known of it before any device is touched, and its devices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from adaptsim_cli.calibration.parts import Hands
from adaptsim_cli.devices.mounted import MountedTask
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.session.rig import Rig
from calib.types import HandEye
from hw.collision import KeepOut, Tool
from hw.ports import Arm, Camera, GuardedArm, Hand
from hw.types import Array
from hw.workcell import Workcell

if TYPE_CHECKING:
    from sim.lab.board import HeldBoard


@dataclass(frozen=True, eq=False)
class BoardDevices:
    """Connected for a calibration, the board in the gripper."""

    arm: Arm
    camera: Camera  # its frames have an infrared image
    pause: Callable[[float], None]  # seconds; the simulated lab does not wait
    hands: Hands | None  # None: a person at the terminal


@dataclass(frozen=True, eq=False)
class TouchDevices:
    """Connected for a touch-off, the hand empty."""

    arm: GuardedArm
    hand: Hand
    tool_there: Callable[[bool], None]  # the tool is held between the open fingers, or was taken away
    confirm: Callable[[], None]  # has a real arm's first motion confirmed. Raises StoppedByOperator


class Lab(Protocol):
    """A lab while a command works in it. Nothing moves by opening; each `for_...` may raise DeviceUnavailable."""

    @property
    def rig(self) -> RigDescription:
        """The rig file's content; the simulated lab has one too."""
        ...

    @property
    def title(self) -> str:
        """What an operator calls it."""
        ...

    @property
    def nominal(self) -> HandEye | None:
        """The camera's pose before any calibration; None: it is not known."""
        ...

    def boxes_around_camera(self, X_BC: Array) -> tuple[KeepOut, ...]:
        """What trials keep out of beside the rig's own boxes, with the camera at X_BC (4, 4)."""
        ...

    def note(self, message: str) -> None:
        """Tell the person beside the arm, where there is one."""
        ...

    def for_trials(self, there: MountedTask, hand_eye: HandEye, days: int) -> Rig:
        """`hand_eye` is the camera's pose over the table, warned of from an age of `days` on."""
        ...

    def for_calibration(self, held: HeldBoard, cell: Workcell, home_rad: Array) -> BoardDevices:
        """Arm and camera, connected, with `held` in the gripper; `cell` decides which motions are allowed."""
        ...

    def for_touch_off(self, cell: Workcell, loaded: Tool) -> TouchDevices:
        """`cell` is with the empty hand, `loaded` the hand with the tool."""
        ...
