"""Opening a real lab for a touch-off: its rig file, calibration, pedal and confirmation, its arm and its hand."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from adaptsim_cli.config import Config, Places
from adaptsim_cli.mounted import weighed
from adaptsim_cli.rigs.description import TablePart
from adaptsim_cli.rigs.opening import enter_arm, open_arm
from adaptsim_cli.rigs.reading import rig_of, tasks_with_tools
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.touch_off.joining import plan_of, touch_rig
from adaptsim_cli.touch_off.parts import Grasp, Plan, TouchRig
from adaptsim_cli.wiring_calibration import calibration_key, calibration_of
from hw.collision import camera_box
from hw.workcell import Workcell, arm_model
from sim.errors import NotExecutable

if TYPE_CHECKING:
    from adaptsim_cli.rigs.openers import Openers


@contextmanager
def open_real_touch_rig(
    config: Config, places: Places, grasp: Grasp, openers: Openers | None = None
) -> Iterator[TouchRig]:
    """Pedal, hand and arm of the rig file, connected, the arm last. Nothing moves.

    Everything that can be wrong without a device is found first. Raises UsageError (rig file, no terminal), UnknownName
    (a tool without corners), CalibrationMissing, NotExecutable (places outside of the work area), DeviceUnavailable.
    """
    from adaptsim_cli.rigs.openers import real_devices
    from hw.franka.settings import Payload
    from sim.panda.feelers import empty_hand, feeling
    from sim.tasks import get_task

    rig = rig_of(config, tasks_with_tools())
    console.require_terminal("a real arm moves only when a person at a terminal confirms it; --yes does not")
    shipped, part = get_task(config.task), rig.tool(config.task)
    plan = plan_of(shipped)
    _require_inside(plan, rig.table)
    eye, zeros_rad = calibration_of(config, places, None)
    task = replace(shipped, X_FT=part.designed(shipped.X_FT))
    empty, loaded, screen = empty_hand(), weighed(feeling(task, task.X_FT), part), Screen(as_json=True)
    model, boxes = arm_model(rig.arm.model, zeros_rad), (camera_box(eye.X_BC), *rig.boxes())
    cell = Workcell(model, empty, rig.table.plane(), boxes, rig.arm.stops_at_N)
    held = Payload() if part.payload is None else part.payload.payload()
    devices = openers or real_devices()
    with ExitStack() as stack:
        arm = open_arm(rig, task.name, cell, devices, screen, stack, "nothing on the table")
        hand = stack.enter_context(devices.hand(rig.arm.model, rig.arm.address))

        def tool_there(there: bool) -> None:
            arm.carry(loaded if there else empty, held if there else Payload())

        opened = touch_rig(
            name=config.hw,
            title=f"lab {rig.name}, {rig.arm.model} at {rig.arm.address}",
            key=calibration_key(config),
            arm=arm,
            hand=hand,
            task=task,
            grasp=grasp,
            cell=cell,
            loaded=loaded,
            tool_there=tool_there,
            confirm=arm.confirm,
        )
        enter_arm(arm, screen, stack)
        yield opened


def _require_inside(plan: Plan, area: TablePart) -> None:
    for probe in (*plan.table, *plan.tool):
        if not area.covers(probe.xy_m):
            x_m, y_m = probe.xy_m
            raise NotExecutable(
                f"{probe.name} would be touched at x {x_m:.3f} m, y {y_m:+.3f} m, which is outside of the work area, x "
                f"{area.x_m}, y {area.y_m}: widen [table] of the rig file where the table is free"
            )
