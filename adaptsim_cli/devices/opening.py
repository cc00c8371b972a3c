"""From the settings to the connected devices of a real lab, the arm behind its confirmation. Called by `wiring` alone.

There is no other way to a device of a real lab: sessions, calibrations and touch-offs ask the same `RealLab` for what
they need.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager

from adaptsim_cli.config import Config
from adaptsim_cli.devices.attended import Scales, offer_recovery
from adaptsim_cli.devices.confirmed import ConfirmedArm
from adaptsim_cli.devices.openers import Openers
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.devices.rig_file.reading import rig_of
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from hw.ports import Camera, Hand
from hw.workcell import Workcell


@contextmanager
def open_lab(config: Config, tools: Collection[str], openers: Openers | None) -> Iterator[RealLab]:
    """The lab of the rig file with a person at a terminal. No device is connected yet; at the end all are left.

    `tools` are the tasks that the file may have one for, where that is to be checked; `openers`: how devices are
    opened, None: by the makers' drivers. Raises UsageError (rig file, no terminal).
    """
    from adaptsim_cli.devices.openers import real_devices

    rig = rig_of(config, tools)
    console.require_terminal("a real arm moves only when a person at a terminal confirms it; --yes does not")
    with ExitStack() as stack:
        yield RealLab(rig, openers or real_devices(), stack)


class RealLab:
    """A real lab while a command works in it. Nothing moves by opening; each method may raise DeviceUnavailable."""

    def __init__(self, rig: RigDescription, openers: Openers, stack: ExitStack) -> None:
        self.rig, self.screen = rig, Screen(as_json=True)  # questions never mix with data
        self._openers, self._stack = openers, stack

    @property
    def title(self) -> str:
        """What an operator calls it."""
        return f"lab {self.rig.name}, {self._where}"

    @property
    def _where(self) -> str:
        return f"{self.rig.arm.model} at {self.rig.arm.address}"

    def arm(self, cell: Workcell, tool: str, on_table: str = "nothing on the table but the object") -> ConfirmedArm:
        """The arm behind its confirmation, to be connected last (`connect`); the pedal of the rig, connected.

        `tool` names its payload in the rig file, `on_table` is what the confirmation asks for.
        """
        rig = self.rig
        pedal = None if rig.pedal is None else self._stack.enter_context(self._openers.pedal(rig.pedal.port))
        payload = rig.tool(tool).payload
        settings = rig.arm.settings(None if payload is None else payload.payload())
        bare = self._openers.arm(cell, settings, pedal=pedal)
        return ConfirmedArm(bare, self._where, self.screen, pedal, table=on_table)

    def camera(self, *, infrared: bool) -> Camera:
        return self._stack.enter_context(self._openers.camera(self.rig.camera, infrared=infrared))

    def hand(self) -> Hand:
        return self._stack.enter_context(self._openers.hand(self.rig.arm.model, self.rig.arm.address))

    def scales(self) -> Scales | None:
        """None where the rig has no balance."""
        if self.rig.balance is None:
            return None
        return Scales(self._stack.enter_context(self._openers.balance(self.rig.balance)), self.screen)

    def connect(self, arm: ConfirmedArm) -> None:
        """The last of the devices."""
        self._stack.enter_context(arm)

    def connect_recovered(self, arm: ConfirmedArm) -> None:
        """As `connect`; a fault is cleared once a person types so."""
        self.connect(arm)
        offer_recovery(arm, self.screen)
