"""Outputs of the commands around the rig: calibrate, touch-off, doctor, config."""

from __future__ import annotations

from typing import Any

from adaptsim_cli.screen.outputs import Output, described, optional
from hw.records import Record

Matrix = list[list[float]]
Numbers = list[float]


class Calibration(Output):
    """One calibration."""

    accepted: bool = described("whether it passed every check and gate")
    X_BC: Matrix | None = optional("pose of a fixed camera in the arm's base, 4 x 4, m; null for a camera at the wrist")
    X_FC: Matrix | None = optional("pose of a camera at the wrist in the flange, 4 x 4, m; null for a fixed one")
    sigma_mm: float = described("uncertainty of the camera's position, one standard deviation")
    sigma_deg: float = described("uncertainty of the camera's orientation, one standard deviation")
    worst_95_mm: float = described("95 % of calibrations have a smaller error everywhere in the work volume")
    fit_px: float = described("residual of the fitted views")
    held_out_px: float | None = described("residual of held-out views; null if there were too few")
    views_used: list[str] = described("fitted views")
    views_rejected: dict[str, str] = described("views that were left out, and why")
    joint_offsets_mrad: Numbers = described("true joint position minus what the arm reports; zeros where not adopted")
    target: str = described("the checks")
    refined_intrinsics: dict[str, Any] | None = described("intrinsics of the camera, if its own were not good enough")
    temperatures_C: Any = described("of the camera while views were taken; null if it does not report it")
    uncertainty: dict[str, Any] = described("every measure of the pose's uncertainty")
    checks: list[dict[str, Any]] = described("every check with value, limit and verdict")
    gates: list[dict[str, Any]] = described("every other condition for accepting it")
    sha256: str = described("hash of the poses")
    folder: str | None = optional("its folder; null for views from elsewhere")
    residuals: str | None = optional("table of every residual, for views from elsewhere")
    report: str | None = optional("page that was written, for views from elsewhere")
    recognised: list[str] | None = optional("conventions recognised in a folder of views from elsewhere")
    views_that_help: dict[str, Any] | None = optional("how much each view contributes, for views from elsewhere")
    three_more: dict[str, Any] | None = optional(
        "the three further views that would help most, for views from elsewhere"
    )
    faults: list[dict[str, Any]] | None = optional(
        "suspected faults, and the option that corrects each, for views from elsewhere"
    )
    advice: str | None = optional("the one most effective next step, for views from elsewhere")


class CalibrationCheck(Output):
    """Three views against the calibration in use."""

    moved: bool = described("whether the camera was moved")
    rms_px: float = described("residual of the three views")
    limit_px: float = described("limit of the residual for a camera that has not moved")
    moved_mm: float = described("distance of the camera from its calibrated position")
    moved_deg: float = described("angle to its calibrated orientation")
    sigma_mm: float = described("its uncertainty, one standard deviation")
    sigma_deg: float = described("its uncertainty, one standard deviation")
    X_BC_now: Matrix = described("pose of the camera by these views, 4 x 4, m")
    message: str = described("the comparison in one sentence")


class CalibrationList(Output):
    """The calibrations of one rig, oldest first."""

    rig: str = described("which rig or world")
    calibrations: list[dict[str, Any]] = described(
        "each with name, created, camera_m, sigma_mm, sigma_deg, views, in_use, restored_from, report; or with error"
    )
    open_sessions: list[str] = described("sessions that use the current one")


class CalibrationsCompared(Output):
    """Two calibrations beside each other."""

    first: str = described("name of the first")
    second: str = described("name of the second")
    moved_mm: Numbers = described("from the camera's first position to its second, x, y, z in the base")
    distance_mm: float = described("length of that")
    turned_deg: float = described("angle between the two")
    known_to_mm: float = described("uncertainty of the distance, one standard deviation")
    known_to_deg: float = described("uncertainty of the angle, one standard deviation")
    joint_zeros_mrad: Numbers = described("joint zeros of the second minus those of the first")
    camera_late_ms: float = described("delay of the camera's time stamps in the second minus that in the first")


class Restored(Output):
    """An earlier calibration or touch-off that is in use again."""

    in_use: str = described("name of the copy now in use")
    restored_from: str = described("name of the original")
    folder: str = described("its folder")


class Overlay(Output):
    """The arm drawn into pictures."""

    outline: dict[str, Any] | None = described("fit of the hand's outline; null if not measured")
    sheet: str = described("some of the pictures side by side")
    pictures: dict[str, str] = described("the picture of every view")


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


class Cameras(Output):
    """Several cameras around one arm."""

    target: str = described("the checks")
    size_sigma: float | None = described("difference from the stated size, in standard deviations")
    held_out_px: float | None = described("residual of held-out views")
    accepted: bool = described("whether every camera passed every gate")
    weights: str = described("which of two fits was kept, and how both predict held-out views")
    X_FM: Matrix = described("pose of the target in the flange, 4 x 4, m")
    cameras: list[CameraOutput] = described("one each")
    file: str = described("file that was written")


class BoardOutput(Output):
    """A printed calibration board."""

    file: str = described("page that was written")
    paper: str = described("size of the paper")
    board: dict[str, Any] = described("the board now in use, as in board.toml")
    nominal_square_mm: float = described("side of a square as drawn")
    measured: bool = described("whether its width was measured on the print")


class Measured(Record):
    """A value with its interval."""

    value: float = described("the value, in the unit that the name ends with")
    within_95: float = described("half width of its 95 % interval, in the same unit")


class TouchOff(Output):
    """One touch-off."""

    table_height_mm: Measured = described("table under the base's axis")
    table_tilt_x_mm_m: Measured = described("rise of the table along X")
    table_tilt_y_mm_m: Measured = described("rise of the table along Y")
    tool_height_mm: Measured = described("how much higher the tool sits than in the nominal mount")
    tool_forward_mm: Measured = described("how much further forward it sits")
    tool_pitch_deg: Measured = described("how much further its edge is pitched down")
    tool_roll_deg: Measured = described("how much further its left side is rolled up")
    edge_over_table_within_95_mm: float = described(
        "half width of the 95 % interval of the edge's height over the table"
    )
    edge_too_high_95_mm: float = described(
        "how much higher than assumed the edge may be, at most, in 95 % of touch-offs"
    )
    misfit_mm: float = described("differences of the touches from the solution")
    touches: int = described("touches that it was computed from")
    sha256: str = described("hash of the values")
    folder: str = described("its folder")


class TouchOffList(Output):
    """The touch-offs of one rig and task, oldest first."""

    rig: str = described("which rig or world, and task")
    touch_offs: list[dict[str, Any]] = described(
        "each with name, created, table_height_mm, tool_height_mm, tool_forward_mm, tool_pitch_deg, tool_roll_deg, "
        "touches, in_use, restored_from; or with error"
    )
    open_sessions: list[str] = described("sessions that use the current one")


class ComparedValue(Record):
    """One quantity of two touch-offs."""

    quantity: str = described("what it is")
    unit: str = described("its unit")
    first: float = described("its value in the first")
    second: float = described("its value in the second")
    difference: float = described("second minus first")
    within_95: float = described("half width of the 95 % interval of the difference")


class TouchOffsCompared(Output):
    """Two touch-offs beside each other."""

    first: str = described("name of the first")
    second: str = described("name of the second")
    quantities: list[ComparedValue] = described("one each")


class CheckOutput(Record):
    """One line of the checklist."""

    group: str = described("part of the lab")
    name: str = described("the checks")
    verdict: str = described("ok, advice, missing or skipped; only missing keeps an iteration from running")
    detail: str = described("the finding")
    fix: str = described("the remedy, as a command if there is one")


class Doctor(Output):
    """The checklist."""

    ready: bool = described("whether an iteration can run")
    hw: str = described("hardware that was checked: fake, panda, fr3 or fr3v2")
    task: str = described("which task")
    checks: list[CheckOutput] = described("one each")


class DeviceRow(Record):
    """One device that this computer can reach, or the reason why its kind cannot be listed."""

    device: str = described("which kind of device")
    name: str = described("its serial number, port or address; none: no device of this kind")
    answer: str = described("its answer, or the reason why there is none")
    entry: str = described("its entry in the rig file; empty: not known")


class Devices(Output):
    """The devices that this computer can reach."""

    devices: list[DeviceRow] = described("one each")


class Setting(Record):
    """One setting."""

    value: str | int | float | bool = described("its value")
    source: str = described("where it comes from: flag, environment, project file, user file or default")


class Settings(Output):
    """Every setting with its origin."""

    settings: dict[str, Setting] = described("by name, as in adaptsim.toml")
    rig_file: dict[str, Any] | None = described("contents of the rig file; null without one")


class PlacesOutput(Output):
    """Where data and settings lie."""

    data: str = described("folder of all data")
    user_file: str = described("settings of the user")
    project_file: str = described("settings of this folder")
    trust_file: str = described("files of current folders that a person has confirmed")


class PartFile(Output):
    """One solid to print."""

    file: str = described("binary STL, mm")
    count: int = described("how many to print")
    notes: list[str] = described("size, mass, orientation, screws")


class PartsOutput(Output):
    """The parts that a lab prints."""

    sheet: str = described("PDF with drawings, and the patch at true size")
    parts: list[PartFile] = described("each solid")
