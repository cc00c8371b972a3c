"""Outputs of calibrate and touch-off, and the rows inside those of other commands around the rig."""

from __future__ import annotations

from typing import Any

from adaptsim_cli.screen.outputs import FOLDER, Output, described, optional, printed
from hw.records import Record

Matrix = list[list[float]]


class CameraOutput(Record):
    """One of several cameras."""

    name: str = described("its name")
    X_BC: Matrix = described("its pose in the arm's base, 4 x 4, m")
    views_used: list[str] = described("fitted views")
    views_rejected: dict[str, str] = described("views that were left out, and why")
    faults: list[dict[str, Any]] = described("suspected faults of its views")
    gates: list[dict[str, Any]] = described("every condition for accepting it")
    fit_px: float | None = described("residual of these views")
    held_out_px: float | None = described("residual of held-out views")
    held_out_alone_px: float | None = described("the same if the camera is solved alone")
    sigma_mm: float | None = described("uncertainty of its position, one standard deviation")
    sigma_alone_mm: float | None = described("the same if the camera is solved alone")
    worst_95_mm: float | None = described("95 % of calibrations have a smaller error everywhere in the work volume")
    worst_95_alone_mm: float | None = described("the same if the camera is solved alone")
    from_alone_mm: float | None = described("distance of the two solutions")


class Measured(Record):
    """A value with its interval."""

    value: float = described("the value, in the unit that the name ends with")
    within_95: float = described("half width of its 95 % interval, in the same unit")


class ComparedValue(Record):
    """One quantity of two touch-offs."""

    quantity: str = described("what it is")
    unit: str = described("its unit")
    first: float = described("its value in the first")
    second: float = described("its value in the second")
    difference: float = described("second minus first")
    within_95: float = described("half width of the 95 % interval of the difference")


class CheckOutput(Record):
    """One line of the checklist."""

    group: str = described("part of the lab")
    name: str = described("the checks")
    verdict: str = described("ok, advice, missing or skipped; only missing keeps an iteration from running")
    detail: str = described("the finding")
    fix: str = described("the remedy, as a command if there is one")


class DeviceRow(Record):
    """One device that this computer can reach, or the reason why its kind cannot be listed."""

    device: str = described("which kind of device")
    name: str = described("its serial number, port or address; none: no device of this kind")
    answer: str = described("its answer, or the reason why there is none")
    entry: str = described("its entry in the rig file; empty: not known")


class Setting(Record):
    """One setting."""

    value: str | int | float | bool = described("its value")
    source: str = described("where it comes from: flag, environment, project file, user file or default")


class PartFile(Output):
    """One solid to print."""

    file: str = described("binary STL, mm")
    count: int = described("how many to print")
    notes: list[str] = described("size, mass, orientation, screws")


CALIBRATION = printed(
    "One calibration.",
    accepted=(bool, "whether it passed every check and gate"),
    X_BC=(
        Matrix | None,
        optional("pose of a fixed camera in the arm's base, 4 x 4, m; null for a camera at the wrist"),
    ),
    X_FC=(Matrix | None, optional("pose of a camera at the wrist in the flange, 4 x 4, m; null for a fixed one")),
    sigma_mm=(float, "uncertainty of the camera's position, one standard deviation"),
    sigma_deg=(float, "uncertainty of the camera's orientation, one standard deviation"),
    worst_95_mm=(float, "95 % of calibrations have a smaller error everywhere in the work volume"),
    fit_px=(float, "residual of the fitted views"),
    held_out_px=(float | None, "residual of held-out views; null if there were too few"),
    views_used=(list[str], "fitted views"),
    views_rejected=(dict[str, str], "views that were left out, and why"),
    joint_offsets_mrad=(list[float], "true joint position minus what the arm reports; zeros where not adopted"),
    target=(str, "the checks"),
    refined_intrinsics=(dict[str, Any] | None, "intrinsics of the camera, if its own were not good enough"),
    temperatures_C=(Any, "of the camera while views were taken; null if it does not report it"),
    uncertainty=(dict[str, Any], "every measure of the pose's uncertainty"),
    checks=(list[dict[str, Any]], "every check with value, limit and verdict"),
    gates=(list[dict[str, Any]], "every other condition for accepting it"),
    sha256=(str, "hash of the poses"),
    folder=(str | None, optional("its folder; null for views from elsewhere")),
    residuals=(str | None, optional("table of every residual, for views from elsewhere")),
    report=(str | None, optional("page that was written, for views from elsewhere")),
    recognised=(list[str] | None, optional("conventions recognised in a folder of views from elsewhere")),
    views_that_help=(dict[str, Any] | None, optional("how much each view contributes, for views from elsewhere")),
    three_more=(
        dict[str, Any] | None,
        optional("the three further views that would help most, for views from elsewhere"),
    ),
    faults=(
        list[dict[str, Any]] | None,
        optional("suspected faults, and the option that corrects each, for views from elsewhere"),
    ),
    advice=(str | None, optional("the most effective next step, for views from elsewhere")),
)

RESTORED = printed(
    "An earlier calibration or touch-off that is in use again.",
    in_use=(str, "name of the copy now in use"),
    restored_from=(str, "name of the original"),
    folder=FOLDER,
)

TOUCH_OFF = printed(
    "One touch-off.",
    table_height_mm=(Measured, "table under the base's axis"),
    table_tilt_x_mm_m=(Measured, "rise of the table along X"),
    table_tilt_y_mm_m=(Measured, "rise of the table along Y"),
    tool_height_mm=(Measured, "how much higher the tool sits than in the nominal mount"),
    tool_forward_mm=(Measured, "how much further forward it sits"),
    tool_pitch_deg=(Measured, "how much further its edge is pitched down"),
    tool_roll_deg=(Measured, "how much further its left side is rolled up"),
    edge_over_table_within_95_mm=(float, "half width of the 95 % interval of the edge's height over the table"),
    edge_too_high_95_mm=(float, "how much higher than assumed the edge may be, at most, in 95 % of touch-offs"),
    misfit_mm=(float, "differences of the touches from the solution"),
    touches=(int, "touches that it was computed from"),
    sha256=(str, "hash of the values"),
    folder=FOLDER,
)
