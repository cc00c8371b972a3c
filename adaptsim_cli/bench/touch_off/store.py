"""Stores touch-offs in `<data>/touch-offs/<rig>/touch-off-0001/touch-off.json`, whole or not at all.

The highest number counts; nothing is overwritten. An unreadable one stops the program.
"""

from __future__ import annotations

from pathlib import Path

from adaptsim_cli.bench.touch_off.solving import MeasuredValue
from adaptsim_cli.storage.numbered import NumberedRecords
from calib.types import StoredRecord
from hw.collision import Table
from hw.records import Record
from sim.panda.tool import ToolCorrection

FILE, PREFIX = "touch-off.json", "touch-off-"
FORMAT = 1


class SlowTouchRecord(Record):
    """One slow touch."""

    place: str
    q_rad: tuple[float, ...]  # true joints by the calibration


class SlipCheckRecord(Record):
    """How the tool held when it was pressed onto the table."""

    moved_m: float  # how far a corner moved
    pressed_N: float
    grasp_force_N: float


class SavedTouchOff(StoredRecord):
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
    edge_too_high_m: float  # at most, in 95 % of touch-offs
    repeat_m: float
    misfit_m: float
    slip: SlipCheckRecord | None = None  # None: set down by hand, so nothing was pressed
    joint_zeros_rad: tuple[float, ...]  # of the calibration in use then
    touches: tuple[SlowTouchRecord, ...]
    versions: dict[str, str]

    def correction(self) -> ToolCorrection:
        """The corrections of table and tool, for planning."""
        return ToolCorrection(
            Table(self.table_origin_m, self.tilt_x.value, self.tilt_y.value),
            self.tool_height_m.value,
            self.tool_forward_m.value,
            self.tool_pitch_rad.value,
            self.tool_roll_rad.value,
        )


class TouchOffStore(NumberedRecords[SavedTouchOff]):
    """All touch-offs of one rig."""

    kind, file, prefix, command = SavedTouchOff, FILE, PREFIX, "touch-off"

    def save(self, saved: SavedTouchOff) -> Path:
        """Store a touch-off, which becomes the current one; return its folder. Raises DiskFull, SessionError."""
        return self.add({FILE: saved.content()})
