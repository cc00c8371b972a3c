"""The drivers of a real lab's devices: the makers', or stand-ins in tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from hw.collision import Tool
from hw.ports import Balance, Camera, GuardedArm, Hand, Pedal
from hw.workcell import Workcell

if TYPE_CHECKING:
    from adaptsim_cli.devices.rig_file.description import BalancePart, CameraPart
    from hw.franka.settings import FrankaSettings, Payload


class RealArm(GuardedArm, Protocol):
    """The arm of a lab, which has to know the load in its hand."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Real-time properties that the computer denies its process, one sentence each; known once it is connected."""
        ...

    def carry(self, tool: Tool, payload: Payload) -> None:
        """Set the load, for the checks and for the arm's weight compensation. Nothing moves. Raises HardwareError."""
        ...


class OpenArm(Protocol):
    """Makes the arm of a rig, not connected; it refuses what `cell` does not allow."""

    def __call__(self, cell: Workcell, settings: FrankaSettings, *, pedal: Pedal | None) -> RealArm:
        """The arm, not connected. Raises DeviceUnavailable if its driver is not installed."""
        ...


class OpenCamera(Protocol):
    """Makes the camera of a rig, not connected; `infrared` asks for that image in every frame."""

    def __call__(self, part: CameraPart, *, infrared: bool) -> Camera:
        """The camera, not connected. Raises DeviceUnavailable if its driver is not installed."""
        ...


class OpenHand(Protocol):
    """Makes the hand of an arm of this model at `host`, not connected. With a pedal it moves while that is held."""

    def __call__(self, model: str, host: str, *, pedal: Pedal | None) -> Hand:
        """The hand, not connected."""
        ...


@dataclass(frozen=True)
class Drivers:
    """One function per device."""

    arm: OpenArm
    camera: OpenCamera
    pedal: Callable[[str], Pedal]
    balance: Callable[[BalancePart], Balance]
    hand: OpenHand


def makers_drivers() -> Drivers:
    """The adapters of `hw`. An SDK is loaded when its device is entered; DeviceUnavailable names a missing one."""
    from hw.camera.process import CameraProcess
    from hw.franka.arm import open_franka
    from hw.franka.hand_process import HandProcess
    from hw.serial import balance, enable_pedal

    return Drivers(
        arm=open_franka,
        camera=lambda part, *, infrared: CameraProcess(part.serial or None, part.settings(), infrared=infrared),
        pedal=enable_pedal.EnablePedal,
        balance=lambda part: balance.SerialBalance(part.port, part.protocol),
        hand=HandProcess,
    )
