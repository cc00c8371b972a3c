"""From a rig file to the arm of a real lab, behind its confirmation. Called by `wiring` alone."""

from __future__ import annotations

from contextlib import ExitStack

from adaptsim_cli.devices.attended import offer_recovery
from adaptsim_cli.devices.confirmed import ConfirmedArm
from adaptsim_cli.devices.openers import Openers
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.screen.console import Screen
from hw.workcell import Workcell


def open_arm(
    rig: RigDescription,
    task: str,
    cell: Workcell,
    openers: Openers,
    screen: Screen,
    stack: ExitStack,
    on_table: str = "nothing on the table but the object",
) -> ConfirmedArm:
    """The arm, not connected yet, behind its confirmation; the pedal of the rig, connected on `stack`.

    `on_table` is what the confirmation asks for.
    """
    pedal = None if rig.pedal is None else stack.enter_context(openers.pedal(rig.pedal.port))
    payload = rig.tool(task).payload
    settings = rig.arm.settings(None if payload is None else payload.payload())
    bare = openers.arm(cell, settings, pedal=pedal)
    return ConfirmedArm(bare, f"{rig.arm.model} at {rig.arm.address}", screen, pedal, table=on_table)


def enter_arm(arm: ConfirmedArm, screen: Screen, stack: ExitStack) -> None:
    """Connect it on `stack`, the last of its devices; a fault that a person lets go of is cleared. Nothing moves.

    Raises DeviceUnavailable.
    """
    stack.enter_context(arm)
    offer_recovery(arm, screen)
