"""From a rig file to the connected devices of a real lab, joined for trials. Called by `wiring` alone."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

from adaptsim_cli.config import Config, Places
from adaptsim_cli.mounted import mounted
from adaptsim_cli.rigs.attended import AttendedRig, Person, Scales, offer_recovery
from adaptsim_cli.rigs.confirmed import ConfirmedArm
from adaptsim_cli.rigs.description import RigDescription
from adaptsim_cli.rigs.openers import Openers
from adaptsim_cli.rigs.reading import rig_of, tasks_with_tools
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.on_rig import OnRig
from adaptsim_cli.session.parts import Rig
from adaptsim_cli.session.records import RigFacts
from adaptsim_cli.touch_off.store import touch_off_of
from adaptsim_cli.trackers import tracker_of
from adaptsim_cli.wiring_calibration import calibration_of
from hw.collision import camera_box
from hw.workcell import Workcell, arm_model
from sim.tasks.task import Task


@runtime_checkable
class _Telling(Protocol):
    """A camera that says how it was set and how its last recording went."""

    def facts(self) -> dict[str, Any]: ...


@contextmanager
def open_real(config: Config, places: Places, task: Task, openers: Openers) -> Iterator[AttendedRig]:
    """The devices of the rig file, connected, the arm last. Nothing moves.

    Everything that can be wrong without a device is found first. Raises UsageError (rig file, no terminal),
    SessionError (a touch-off cannot be read), PreflightFailed (it is stale), CalibrationMissing, NotExecutable (the
    tool cannot be held), DeviceUnavailable, CameraError.
    """
    rig = rig_of(config, tasks_with_tools())
    console.require_terminal("a real arm moves only when a person at a terminal confirms it; --yes does not")
    eye, zeros_rad = calibration_of(config, places, None)
    known = touch_off_of(config, places, zeros_rad)  # what it found counts more than what the rig file says
    correction = None if known is None else known.correction()
    lab = mounted(task, arm_model(rig.arm.model, zeros_rad), rig, (camera_box(eye.X_BC),), correction)
    screen = Screen(as_json=True)  # questions never mix with data
    if known is not None:
        screen.note(f"Table and tool are where the touch-off of {known.created} found them.")
    with ExitStack() as stack:
        arm = open_arm(rig, lab.task.name, lab.cell, openers, screen, stack)
        camera = stack.enter_context(openers.camera(rig.camera, infrared=False))
        scales = None
        if rig.balance is not None:
            scales = Scales(stack.enter_context(openers.balance(rig.balance)), screen)
        stack.enter_context(arm)

        def facts() -> RigFacts:
            said = camera.facts() if isinstance(camera, _Telling) else None
            return (scales.facts if scales else RigFacts()).model_copy(update={"camera": said})

        title = f"lab {rig.name}, {rig.arm.model} at {rig.arm.address}"
        over_table = replace(eye, X_BC=lab.correction.X_WB @ eye.X_BC)  # trials are seen over the table, in the frame W
        days = config.calibration_days
        devices = Rig(config.hw, title, arm, camera, Person(), over_table, days, time.sleep, arm.await_pedal)
        on_rig = OnRig(lab.task, devices, tracker_of(lab.task), lab.planner(), facts)
        yield AttendedRig(on_rig, arm, lab, screen, scales)


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
