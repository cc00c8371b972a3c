"""Joins the real parts of a touch-off, and finds the touch-off that a rig has."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from adaptsim_cli.config import SIMULATED, Config, Places
from adaptsim_cli.devices.mounted import weighed
from adaptsim_cli.devices.openers import Openers
from adaptsim_cli.devices.opening import open_lab
from adaptsim_cli.devices.rig_file.description import TablePart
from adaptsim_cli.devices.rig_file.reading import tasks_with_tools
from adaptsim_cli.errors import PreflightFailed
from adaptsim_cli.touch_off.joining import plan_of, touch_rig
from adaptsim_cli.touch_off.parts import Grasp, Plan, TouchRig
from adaptsim_cli.touch_off.store import SavedTouchOff, TouchOffStore
from adaptsim_cli.wiring.calibration import calibration_key, calibration_of, current_calibration
from hw.collision import LEVEL, camera_box
from hw.types import Array
from hw.workcell import STOPS_AT_N, Workcell, arm_model
from sim.errors import NotExecutable

ZEROS_RAD = 2e-4
"""Joint offsets that differ by more are others: 0.13 mm at the edge of a tool that a shoulder holds 0.65 m away."""


def touch_offs(config: Config, places: Places) -> TouchOffStore:
    """Those of this rig: of the simulated lab one a task, world and seed, else one an arm and task."""
    key = calibration_key(config)
    return TouchOffStore(places.data / "touch-offs" / (key if config.is_simulated else f"{key}-{config.task}"))


def touch_off_of(config: Config, places: Places, zeros_rad: Array) -> SavedTouchOff | None:
    """The latest of this rig, None where there is none. `zeros_rad` (7,) are the joint offsets that count now.

    Raises SessionError where it cannot be read, PreflightFailed where it was made with other joint offsets.
    """
    known = touch_offs(config, places).current()
    if known is None:
        return None
    apart_rad = np.abs(zeros_rad - np.array(known.joint_zeros_rad))
    if apart_rad.max() > ZEROS_RAD:
        joint, apart_mrad = int(apart_rad.argmax()) + 1, 1e3 * float(apart_rad.max())
        raise PreflightFailed(
            f"the touch-off of {known.created} was made with another calibration: joint {joint} is {apart_mrad:.2f} "
            "mrad off what it was then, so the tool may be too high or in the table. Nothing has moved. Touch off "
            f"again: adaptsim touch-off --task {config.task} --hw {config.hw}"
        )
    return known


@contextmanager
def open_touch_rig(config: Config, places: Places, grasp: Grasp) -> Iterator[TouchRig]:
    """Arm and hand, connected. Nothing moves.

    Raises SimError, DeviceUnavailable, SessionError; for a real lab also UsageError and CalibrationMissing.
    """
    opened = _lab(config, places, grasp) if config.is_simulated else open_real_touch_rig(config, places, grasp)
    with opened as rig:
        yield rig


@contextmanager
def _lab(config: Config, places: Places, grasp: Grasp) -> Iterator[TouchRig]:
    from sim.lab.calibration import nominal_of
    from sim.lab.simulated import READY_RAD
    from sim.lab.touch import TouchLab
    from sim.lab.world import load_world
    from sim.panda.feelers import empty_hand, feeling
    from sim.tasks import get_task

    task = get_task(config.task)
    world = load_world(config.world, task)
    known = current_calibration(config, places)
    zeros_rad = np.zeros(7) if known is None else known.offsets_rad()
    X_BC = nominal_of(world, config.seed).X_BC if known is None else np.array(known.X_AC)
    cell = Workcell(arm_model("panda", zeros_rad), empty_hand(), LEVEL, (camera_box(X_BC),), STOPS_AT_N)
    with TouchLab(task, world, config.seed, cell, home_q_rad=cell.arm.reported_rad(READY_RAD)) as lab:
        yield touch_rig(
            name=SIMULATED,
            title=f"simulated lab, world {world.name}",
            key=calibration_key(config),
            arm=lab.arm,
            hand=lab.hand,
            task=task,
            grasp=grasp,
            cell=cell,
            loaded=feeling(task.require_hardware()),
            tool_there=lab.offer_tool,
        )


@contextmanager
def open_real_touch_rig(
    config: Config, places: Places, grasp: Grasp, openers: Openers | None = None
) -> Iterator[TouchRig]:
    """Pedal, hand and arm of the rig file, connected, the arm last. Nothing moves.

    Everything that can be wrong without a device is found first. Raises UsageError (rig file, no terminal), UnknownName
    (a tool without corners), CalibrationMissing, NotExecutable (places outside of the work area), DeviceUnavailable.
    """
    from hw.franka.settings import Payload
    from sim.panda.feelers import empty_hand, feeling
    from sim.tasks import get_task

    with open_lab(config, tasks_with_tools(), openers) as lab:
        rig = lab.rig
        shipped, part = get_task(config.task), rig.tool(config.task)
        plan, hardware = plan_of(shipped), shipped.require_hardware()
        _require_inside(plan, rig.table)
        eye, zeros_rad = calibration_of(config, places, None)
        designed = replace(hardware, X_FT=part.designed(hardware.X_FT))
        task, empty, loaded = replace(shipped, hardware=designed), empty_hand(), weighed(feeling(designed), part)
        model, boxes = arm_model(rig.arm.model, zeros_rad), (camera_box(eye.X_BC), *rig.boxes())
        cell = Workcell(model, empty, rig.table.plane(), boxes, rig.arm.stops_at_N)
        held = Payload() if part.payload is None else part.payload.payload()
        arm, hand = lab.arm(cell, task.name, "nothing on the table"), lab.hand()

        def tool_there(there: bool) -> None:
            arm.carry(loaded if there else empty, held if there else Payload())

        opened = touch_rig(
            name=config.hw,
            title=lab.title,
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
        lab.connect_recovered(arm)
        yield opened


def _require_inside(plan: Plan, area: TablePart) -> None:
    for probe in (*plan.table, *plan.tool):
        if not area.covers(probe.xy_m):
            x_m, y_m = probe.xy_m
            raise NotExecutable(
                f"{probe.name} would be touched at x {x_m:.3f} m, y {y_m:+.3f} m, which is outside of the work area, x "
                f"{area.x_m}, y {area.y_m}: widen [table] of the rig file where the table is free"
            )
