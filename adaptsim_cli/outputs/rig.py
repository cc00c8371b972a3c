"""Outputs of the commands around the rig: calibrate, touch-off, doctor, config."""

from __future__ import annotations

from typing import Any

from adaptsim_cli.outputs import Output, maybe, said
from hw.records import Record

Matrix = list[list[float]]
Numbers = list[float]


class Calibration(Output):
    """One calibration."""

    accepted: bool = said("whether it passed every check and gate")
    X_BC: Matrix | None = maybe("pose of a fixed camera in the arm's base, 4 x 4, m; null for a camera at the wrist")
    X_FC: Matrix | None = maybe("pose of a camera at the wrist in the flange, 4 x 4, m; null for a fixed one")
    sigma_mm: float = said("uncertainty of the camera's position, one standard deviation")
    sigma_deg: float = said("uncertainty of the camera's orientation, one standard deviation")
    worst_95_mm: float = said("95 % of calibrations have a smaller error everywhere in the work volume")
    fit_px: float = said("residual of the fitted views")
    held_out_px: float | None = said("residual of held-out views; null if there were too few")
    views_used: list[str] = said("fitted views")
    views_rejected: dict[str, str] = said("views that were left out, and why")
    joint_offsets_mrad: Numbers = said("true joint position minus what the arm reports; zeros where not adopted")
    target: str = said("the checks")
    refined_intrinsics: dict[str, Any] | None = said("intrinsics of the camera, if its own were not good enough")
    temperatures_C: Any = said("of the camera while views were taken; null if it does not report it")
    uncertainty: dict[str, Any] = said("every measure of the pose's uncertainty")
    checks: list[dict[str, Any]] = said("every check with value, limit and verdict")
    gates: list[dict[str, Any]] = said("every other condition for accepting it")
    sha256: str = said("hash of the poses")
    folder: str | None = maybe("its folder; null for views from elsewhere")
    residuals: str | None = maybe("table of every residual, for views from elsewhere")
    report: str | None = maybe("page that was written, for views from elsewhere")
    recognised: list[str] | None = maybe("conventions recognised in a folder of views from elsewhere")
    views_that_help: dict[str, Any] | None = maybe("how much each view contributes, for views from elsewhere")
    three_more: dict[str, Any] | None = maybe("the three further views that would help most, for views from elsewhere")
    faults: list[dict[str, Any]] | None = maybe(
        "suspected faults, and the option that corrects each, for views from elsewhere"
    )
    advice: str | None = maybe("the one most effective next step, for views from elsewhere")


class CalibrationCheck(Output):
    """Three views against the calibration in use."""

    moved: bool = said("whether the camera was moved")
    rms_px: float = said("residual of the three views")
    limit_px: float = said("limit of the residual for a camera that has not moved")
    moved_mm: float = said("distance of the camera from its calibrated position")
    moved_deg: float = said("angle to its calibrated orientation")
    sigma_mm: float = said("its uncertainty, one standard deviation")
    sigma_deg: float = said("its uncertainty, one standard deviation")
    X_BC_now: Matrix = said("pose of the camera by these views, 4 x 4, m")
    message: str = said("the comparison in one sentence")


class CalibrationList(Output):
    """The calibrations of one rig, oldest first."""

    rig: str = said("which rig or world")
    calibrations: list[dict[str, Any]] = said(
        "each with name, created, camera_m, sigma_mm, sigma_deg, views, in_use, restored_from, report; or with error"
    )
    open_sessions: list[str] = said("sessions that use the current one")


class CalibrationsCompared(Output):
    """Two calibrations beside each other."""

    first: str = said("name of the first")
    second: str = said("name of the second")
    moved_mm: Numbers = said("from the camera's first position to its second, x, y, z in the base")
    distance_mm: float = said("length of that")
    turned_deg: float = said("angle between the two")
    known_to_mm: float = said("uncertainty of the distance, one standard deviation")
    known_to_deg: float = said("uncertainty of the angle, one standard deviation")
    joint_zeros_mrad: Numbers = said("joint zeros of the second minus those of the first")
    camera_late_ms: float = said("delay of the camera's time stamps in the second minus that in the first")


class Restored(Output):
    """An earlier calibration or touch-off that is in use again."""

    in_use: str = said("name of the copy now in use")
    restored_from: str = said("name of the original")
    folder: str = said("its folder")


class Overlay(Output):
    """The arm drawn into pictures."""

    outline: dict[str, Any] | None = said("fit of the hand's outline; null if not measured")
    sheet: str = said("some of the pictures side by side")
    pictures: dict[str, str] = said("the picture of every view")


class CameraOutput(Record):
    """One of several cameras."""

    name: str = said("its name")
    X_BC: Matrix = said("its pose in the arm's base, 4 x 4, m")
    views_used: list[str] = said("fitted views")
    views_rejected: dict[str, str] = said("views that were left out, and why")
    faults: list[dict[str, Any]] = said("suspected faults of its views")
    gates: list[dict[str, Any]] = said("every condition for accepting it")
    fit_px: float | None = said("residual of these views")
    held_out_px: float | None = said("residual of held-out views")
    held_out_alone_px: float | None = said("the same if the camera is solved alone")
    sigma_mm: float | None = said("uncertainty of its position, one standard deviation")
    sigma_alone_mm: float | None = said("the same if the camera is solved alone")
    worst_95_mm: float | None = said("95 % of calibrations have a smaller error everywhere in the work volume")
    worst_95_alone_mm: float | None = said("the same if the camera is solved alone")
    from_alone_mm: float | None = said("distance of the two solutions")


class Cameras(Output):
    """Several cameras around one arm."""

    target: str = said("the checks")
    size_sigma: float | None = said("difference from the stated size, in standard deviations")
    held_out_px: float | None = said("residual of held-out views")
    accepted: bool = said("whether every camera passed every gate")
    weights: str = said("which of two fits was kept, and how both predict held-out views")
    X_FM: Matrix = said("pose of the target in the flange, 4 x 4, m")
    cameras: list[CameraOutput] = said("one each")
    file: str = said("file that was written")


class BoardOutput(Output):
    """A printed calibration board."""

    file: str = said("page that was written")
    paper: str = said("size of the paper")
    board: dict[str, Any] = said("the board now in use, as in board.toml")
    nominal_square_mm: float = said("side of a square as drawn")
    measured: bool = said("whether its width was measured on the print")


class Measured(Record):
    """A value with its interval."""

    value: float = said("the value, in the unit that the name ends with")
    within_95: float = said("half width of its 95 % interval, in the same unit")


class TouchOff(Output):
    """One touch-off."""

    table_height_mm: Measured = said("table under the base's axis")
    table_tilt_x_mm_m: Measured = said("rise of the table along X")
    table_tilt_y_mm_m: Measured = said("rise of the table along Y")
    tool_height_mm: Measured = said("how much higher the tool sits than in the nominal mount")
    tool_forward_mm: Measured = said("how much further forward it sits")
    tool_pitch_deg: Measured = said("how much further its edge is pitched down")
    tool_roll_deg: Measured = said("how much further its left side is rolled up")
    edge_over_table_within_95_mm: float = said("half width of the 95 % interval of the edge's height over the table")
    edge_too_high_95_mm: float = said("how much higher than assumed the edge may be, at most, in 95 % of touch-offs")
    repeat_mm: float = said("spread of touches of one place")
    misfit_mm: float = said("differences of the touches from the solution")
    slip_mm: float | None = said("how far the tool slipped in the hand; none if it was set down by hand")
    touches: int = said("touches that it was computed from")
    sha256: str = said("hash of the values")
    folder: str = said("its folder")


class TouchOffList(Output):
    """The touch-offs of one rig and task, oldest first."""

    rig: str = said("which rig or world, and task")
    touch_offs: list[dict[str, Any]] = said(
        "each with name, created, table_height_mm, tool_height_mm, tool_forward_mm, tool_pitch_deg, tool_roll_deg, "
        "touches, in_use, restored_from; or with error"
    )
    open_sessions: list[str] = said("sessions that use the current one")


class ComparedValue(Record):
    """One quantity of two touch-offs."""

    quantity: str = said("what it is")
    unit: str = said("its unit")
    first: float = said("its value in the first")
    second: float = said("its value in the second")
    difference: float = said("second minus first")
    within_95: float = said("half width of the 95 % interval of the difference")


class TouchOffsCompared(Output):
    """Two touch-offs beside each other."""

    first: str = said("name of the first")
    second: str = said("name of the second")
    quantities: list[ComparedValue] = said("one each")


class CheckOutput(Record):
    """One line of the checklist."""

    group: str = said("part of the lab")
    name: str = said("the checks")
    verdict: str = said("ok, advice, missing or skipped; only missing keeps an iteration from running")
    detail: str = said("the finding")
    fix: str = said("the remedy, as a command if there is one")


class Doctor(Output):
    """The checklist."""

    ready: bool = said("whether an iteration can run")
    hw: str = said("hardware that was checked: fake, panda or fr3")
    task: str = said("which task")
    checks: list[CheckOutput] = said("one each")


class Setting(Record):
    """One setting."""

    value: str | int | float | bool = said("its value")
    source: str = said("where it comes from: flag, environment, project file, user file or default")


class Settings(Output):
    """Every setting with its origin."""

    settings: dict[str, Setting] = said("by name, as in adaptsim.toml")
    rig_file: dict[str, Any] | None = said("contents of the rig file; null without one")


class PlacesOutput(Output):
    """Where data and settings lie."""

    data: str = said("folder of all data")
    user_file: str = said("settings of the user")
    project_file: str = said("settings of this folder")


class PartFile(Output):
    """One solid to print."""

    file: str = said("binary STL, mm")
    count: int = said("how many to print")
    notes: list[str] = said("size, mass, orientation, screws")


class PartsOutput(Output):
    """The parts that a lab prints."""

    sheet: str = said("PDF with drawings, and the patch at true size")
    parts: list[PartFile] = said("each solid")
