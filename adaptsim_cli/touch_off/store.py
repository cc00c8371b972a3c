"""Stores touch-offs in `<data>/touch-offs/<rig>/touch-off-0001/touch-off.json`, whole or not at all.

The highest number counts; nothing is overwritten. An unreadable one stops the program.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from adaptsim_cli.storage.numbered import NumberedRecords
from adaptsim_cli.touch_off.flow import TouchOffRun
from adaptsim_cli.touch_off.parts import TouchRig
from adaptsim_cli.touch_off.solving import MeasuredValue
from calib.record import Record
from hw.collision import Table
from sim.panda.tool import ToolCorrection

FILE, PREFIX = "touch-off.json", "touch-off-"
FORMAT = 1


class SlowTouchRecord(Record):
    """One slow touch."""

    place: str
    q_rad: tuple[float, ...]  # true joints by the calibration


class SavedTouchOff(Record):
    """touch-off.json: a finished touch-off."""

    format: int = FORMAT
    created: str  # ISO 8601
    hw: str
    arm: str
    rig: str
    tool: str
    source: str
    table_height_m: MeasuredValue
    tilt_x: MeasuredValue
    tilt_y: MeasuredValue
    table_origin_m: float  # height of the table's plane at the base's axis
    tool_height_m: MeasuredValue
    tool_forward_m: MeasuredValue
    tool_pitch_rad: MeasuredValue
    tool_roll_rad: MeasuredValue
    edge_over_table_m: float
    repeat_m: float
    misfit_m: float
    slip_m: float
    pressed_N: float
    grasp_force_N: float
    joint_zeros_rad: tuple[float, ...]  # of the calibration in use then
    touches: tuple[SlowTouchRecord, ...]
    versions: dict[str, str]

    def correction(self) -> ToolCorrection:
        """The corrections of table and tool, for planning."""
        table = Table(self.table_origin_m, self.tilt_x.value, self.tilt_y.value)
        return ToolCorrection(
            table,
            self.tool_height_m.value,
            self.tool_forward_m.value,
            self.tool_pitch_rad.value,
            self.tool_roll_rad.value,
        )

    def content(self) -> bytes:
        """The bytes of the file."""
        return (json.dumps(self.model_dump(), indent=1, allow_nan=False) + "\n").encode()

    def sha256(self) -> str:
        """The SHA-256 of the file, which sessions record."""
        return hashlib.sha256(self.content()).hexdigest()


def record(found: TouchOffRun, rig: TouchRig, created: str, versions: dict[str, str]) -> SavedTouchOff:
    """The record of a touch-off."""
    result, table = found.result, found.result.correction.table
    return SavedTouchOff(
        created=created,
        hw=rig.name,
        arm=rig.arm.model,
        rig=rig.key,
        tool=rig.tool_name,
        source=f"touch-off on {rig.title}",
        table_height_m=result.table_height_m,
        tilt_x=result.tilt_x,
        tilt_y=result.tilt_y,
        table_origin_m=table.height_m,
        tool_height_m=result.height_m,
        tool_forward_m=result.forward_m,
        tool_pitch_rad=result.pitch_rad,
        tool_roll_rad=result.roll_rad,
        edge_over_table_m=result.edge_over_table_m,
        repeat_m=result.repeat_m,
        misfit_m=result.misfit_m,
        slip_m=found.slip.moved_m,
        pressed_N=found.slip.pressed_N,
        grasp_force_N=rig.grasp.force_N,
        joint_zeros_rad=tuple(float(q) for q in rig.empty.cell.arm.zeros_rad),
        touches=tuple(
            SlowTouchRecord(place=touch.probe.name, q_rad=tuple(map(float, touch.q_rad)))
            for touch in (*found.fingers, *found.tool)
        ),
        versions=versions,
    )


class TouchOffStore(NumberedRecords[SavedTouchOff]):
    """All touch-offs of one rig."""

    kind, file, prefix, command = SavedTouchOff, FILE, PREFIX, "touch-off"

    def save(self, saved: SavedTouchOff) -> Path:
        """Store a touch-off, which becomes the current one; return its folder. Raises DiskFull, SessionError."""
        return self.add({FILE: saved.content()})
