"""The drivers of a real lab's devices: one function each, replaced as a whole in tests and in labs of other makers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adaptsim_cli.bench.devices.lab import RealArm
    from adaptsim_cli.bench.rig_file.description import CameraPart
    from adaptsim_cli.bench.rig_file.devices import BalancePart, PedalPart
    from hw.franka.settings import FrankaSettings
    from hw.ports import Balance, Camera, Hand, Pedal
    from hw.workcell import Workcell


@dataclass(frozen=True, kw_only=True)
class Drivers:
    """One function for each device, which makes it without connecting it. Raises DeviceUnavailable if its driver is
    missing.
    """

    arm: Callable[[Workcell, FrankaSettings, Pedal | None], RealArm]  # it refuses what the cell does not allow
    camera: Callable[[CameraPart, bool], Camera]  # True: with the infrared image in every frame
    pedal: Callable[[PedalPart], Pedal]
    balance: Callable[[BalancePart], Balance]
    hand: Callable[[str, str, Pedal | None], Hand]  # of the arm's model, at a host; with a pedal it moves while held


def makers_drivers() -> Drivers:
    """The adapters of `hw`. An SDK is loaded when its device is entered; DeviceUnavailable names a missing one."""
    from adaptsim_cli.bench.rig_file.devices import BALANCE, PEDAL
    from hw.franka.arm import open_franka
    from hw.franka.hand_process import HandProcess

    return Drivers(
        arm=lambda cell, settings, pedal: open_franka(cell, settings, pedal=pedal),
        camera=lambda part, infrared: part.camera(infrared=infrared),
        pedal=PEDAL.driver,
        balance=BALANCE.driver,
        hand=lambda model, host, pedal: HandProcess(model, host, pedal=pedal),
    )
