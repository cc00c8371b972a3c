"""Joins the parts of a touch-off, and finds a rig's touch-off."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from adaptsim_cli.bench.calibration_in_use import calibration_key, calibration_of
from adaptsim_cli.bench.devices.drivers import Drivers
from adaptsim_cli.bench.devices.mounted import weighed, workcell, written
from adaptsim_cli.bench.devices.opening import open_lab
from adaptsim_cli.bench.rig_file.description import RigDescription, TablePart
from adaptsim_cli.bench.touch_off.parts import Grasp, GuidedTouchRig, HoldingHand
from adaptsim_cli.bench.touch_off.store import SavedTouchOff, TouchOffStore
from adaptsim_cli.config import Config, Places
from adaptsim_cli.errors import PreflightFailed
from adaptsim_cli.screen.console import Screen
from hw.collision import camera_box
from hw.types import Array
from sim.errors import NotExecutable
from sim.panda.setting_down import SetDown
from sim.panda.tool import ToolCorrection
from sim.tasks.task import Task

ZEROS_RAD = 2e-4
"""Joint zeros that differ by more than this (rad) count as others: 0.13 mm at a tool 0.65 m from the shoulder."""


def touch_offs(config: Config, places: Places) -> TouchOffStore:
    """The touch-offs of this rig: one per task, world and seed in the simulated lab, else one per arm and task."""
    key = calibration_key(config)
    return TouchOffStore(places.data / "touch-offs" / (key if config.is_simulated else f"{key}-{config.task}"))


def serving(config: Config, places: Places, task: Task) -> tuple[TouchOffStore, ...]:
    """The touch-offs that serve a task on this rig. A tool without corners has no touch-off of its own, so those of all
    tools count for it, because they touched the same table.
    """
    own = touch_offs(config, places)
    if config.is_simulated or task.require_hardware().touchable is not None:
        return (own,)
    folders = sorted(own.folder.parent.glob(f"{calibration_key(config)}-*"))
    return tuple(TouchOffStore(folder) for folder in folders if folder.is_dir())


def correction_by(touched: SavedTouchOff, rig: RigDescription, task: Task) -> ToolCorrection:
    """The corrections of table and tool for a task; only that of the table if another tool was touched off."""
    if touched.tool == tool_name(task):
        return touched.correction()
    return replace(written(rig, task.name), table=touched.correction().table)


def origin(touched: SavedTouchOff, task: Task) -> str:
    """The sentence for a person about a task's use of a touch-off."""
    if touched.tool == tool_name(task):
        return f"Table and tool come from the touch-off of {touched.created}."
    return f"The table comes from the touch-off of the {touched.tool}, {touched.created}; this tool from the rig file."


def tool_name(task: Task) -> str:
    """The name of a task's tool for a person."""
    return f"{task.name} tool"


def touch_off_of(config: Config, places: Places, task: Task, zeros_rad: Array) -> SavedTouchOff | None:
    """The latest touch-off that serves `task` on this rig, None if there is none. `zeros_rad` (7,) are the present
    joint zeros.

    Raises SessionError if it is unreadable, PreflightFailed if it was made with other joint zeros.
    """
    records = [record for store in serving(config, places, task) if (record := store.current()) is not None]
    if not records:
        return None
    record = max(records, key=lambda one: one.created)
    apart_rad = np.abs(zeros_rad - np.array(record.joint_zeros_rad))
    if apart_rad.max() > ZEROS_RAD:
        joint, apart_mrad = int(apart_rad.argmax()) + 1, 1e3 * float(apart_rad.max())
        raise PreflightFailed(
            f"the touch-off of {record.created} was made with another calibration: joint {joint} is {apart_mrad:.2f} "
            "mrad off what it was then, so the tool may be too high or in the table. Nothing has moved. Touch off "
            f"again: adaptsim touch-off --task {record.tool.split()[0]} --hw {config.hw}"
        )
    return record


def grasp_of(config: Config, handle_mm: float | None = None, force_N: float = 40.0) -> Grasp:
    """The grasp of the task's tool; None: as wide as its adapter. Raises UnknownName for a tool without corners."""
    from sim.panda.tool import touchable
    from sim.tasks import get_task

    held_m = touchable(get_task(config.task).require_hardware()).held_m
    return Grasp(held_m if handle_mm is None else 1e-3 * handle_mm, force_N)


@contextmanager
def open_guided_rig(
    config: Config, places: Places, grasp: Grasp, drivers: Drivers | None = None, screen: Screen | None = None
) -> Iterator[GuidedTouchRig]:
    """The arm, connected, which a person guides, and the hand that holds its tool. Nothing moves.

    Every check that needs no device comes first. Raises UnknownName (a tool without corners), CalibrationMissing,
    SessionError, NotExecutable (places outside the work area), DeviceUnavailable, and the errors of `open_lab`.
    `drivers` are those of a real lab's devices.
    """
    from sim.panda.setting_down import set_downs
    from sim.panda.tool import feeling, touchable
    from sim.tasks import get_task

    task = get_task(config.task)
    with open_lab(config, task, drivers, screen) as lab:
        rig, shipped = lab.rig, task.require_hardware()
        touched = touchable(shipped)
        places_down = set_downs(touched.feelers, touched.centre_m)
        _require_inside(places_down, rig.table)
        eye, zeros_rad = calibration_of(config, places, lab.nominal)
        part = rig.tool(task.name)
        hardware = replace(shipped, X_FT=part.designed(shipped.X_FT))
        cell = workcell(rig, zeros_rad, weighed(feeling(hardware), part), (camera_box(eye.X_BC),))
        arm, hand, pause, person, release = lab.for_touch_off(cell)
        yield GuidedTouchRig(
            name=config.hw,
            title=lab.title,
            key=calibration_key(config),
            tool_name=tool_name(task),
            arm=arm,
            model=cell.arm,
            designed=hardware.X_FT,
            table=cell.table,
            set_downs=places_down,
            work_m=np.array(touched.centre_m),
            pause=pause,
            holding=None if hand is None else HoldingHand(hand, grasp, release),
            person=person,
        )


def _require_inside(set_downs: Sequence[SetDown], area: TablePart) -> None:
    for one in set_downs:
        if not area.covers(one.xy_m):
            x_m, y_m = one.xy_m
            raise NotExecutable(
                f"{one.name} would be touched at x {x_m:.3f} m, y {y_m:+.3f} m, which is outside of the work area, x "
                f"{area.x_m}, y {area.y_m}: widen [table] of the rig file where the table is free"
            )
