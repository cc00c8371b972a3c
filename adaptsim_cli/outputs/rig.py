"""Outputs of the commands around the rig: calibrate, touch-off, doctor, config."""

from __future__ import annotations

from typing import Any

from adaptsim_cli.outputs.base import Output, Part, maybe, said

Matrix = list[list[float]]
Numbers = list[float]


class Calibration(Output):
    """One calibration."""

    accepted: bool = said("whether every check and gate let it pass")
    X_BC: Matrix | None = maybe("pose of a fixed camera in the arm's base, 4 x 4, m; null for a camera at the wrist")
    X_FC: Matrix | None = maybe("pose of a camera at the wrist in the flange, 4 x 4, m; null for a fixed one")
    sigma_mm: float = said("how well the camera's place is known, one standard deviation")
    sigma_deg: float = said("how well the way it looks is known, one standard deviation")
    worst_95_mm: float = said("what is seen in the work volume lies no further off, in 95 % of calibrations")
    fit_px: float = said("residual of the views that it was solved with")
    held_out_px: float | None = said("residual of views that were left out of the solution; null where too few were")
    views_used: list[str] = said("views that it was solved with")
    views_rejected: dict[str, str] = said("views that were left out, and why")
    joint_offsets_mrad: Numbers = said("true joint position minus what the arm reports; zeros where not adopted")
    target: str = said("what was looked at")
    refined_intrinsics: dict[str, Any] | None = said("of the camera, where its own were not good enough")
    temperatures_C: Any = said("of the camera while views were taken; null where it does not tell")
    uncertainty: dict[str, Any] = said("every measure of how far off the pose may be")
    checks: list[dict[str, Any]] = said("every check with value, limit and verdict")
    gates: list[dict[str, Any]] = said("every other condition of accepting it")
    sha256: str = said("hash of the poses")
    folder: str | None = maybe("where it is stored; null for views from elsewhere")
    residuals: str | None = maybe("table of every residual, for views from elsewhere")
    report: str | None = maybe("page that was written, for views from elsewhere")
    recognised: list[str] | None = maybe("what was recognised in a folder of views from elsewhere")
    views_that_help: dict[str, Any] | None = maybe("what each view is worth, for views from elsewhere")
    three_more: dict[str, Any] | None = maybe("which three views would help most, for views from elsewhere")
    faults: list[dict[str, Any]] | None = maybe("what looks wrong, and how to use it so, for views from elsewhere")


class CalibrationCheck(Output):
    """Three views against the calibration in use."""

    moved: bool = said("whether the camera was moved")
    rms_px: float = said("residual of the three views")
    limit_px: float = said("residual up to which it has not")
    moved_mm: float = said("how far the camera stands from where it stood")
    moved_deg: float = said("how far it is turned")
    sigma_mm: float = said("how well that is known, one standard deviation")
    sigma_deg: float = said("how well that is known, one standard deviation")
    X_BC_now: Matrix = said("pose of the camera by these views, 4 x 4, m")
    message: str = said("the comparison in one sentence")


class CalibrationList(Output):
    """The calibrations of one rig, oldest first."""

    rig: str = said("which rig or world")
    calibrations: list[dict[str, Any]] = said(
        "each with name, created, camera_m, sigma_mm, sigma_deg, views, in_use, restored_from, report; or with error"
    )
    open_sessions: list[str] = said("sessions that rest on the one in use")


class CalibrationsCompared(Output):
    """Two calibrations beside each other."""

    first: str = said("name of the first")
    second: str = said("name of the second")
    moved_mm: Numbers = said("from the first place of the camera to the second, x, y, z in the base")
    distance_mm: float = said("length of that")
    turned_deg: float = said("angle between the two")
    known_to_mm: float = said("how well the distance is known, one standard deviation")
    known_to_deg: float = said("how well the angle is known, one standard deviation")
    joint_zeros_mrad: Numbers = said("joint zeros of the second less those of the first")
    camera_late_ms: float = said("delay of the camera's stamps in the second less that in the first")


class Restored(Output):
    """An earlier calibration or touch-off that is in use again."""

    in_use: str = said("name of the copy that is in use from now on")
    restored_from: str = said("name of the one that it is a copy of")
    folder: str = said("where it lies")


class Overlay(Output):
    """The arm drawn into pictures."""

    outline: dict[str, Any] | None = said("how well the hand's outline fits; null where it was not measured")
    sheet: str = said("some of the pictures side by side")
    pictures: dict[str, str] = said("the picture of every view")


class Camera(Part):
    """One of several cameras."""

    name: str = said("its name")
    X_BC: Matrix = said("its pose in the arm's base, 4 x 4, m")
    views_used: list[str] = said("views that it was solved with")
    fit_px: float | None = said("residual of these views")
    held_out_px: float | None = said("residual of views that were left out of the solution")
    held_out_alone_px: float | None = said("the same where the camera is solved alone")
    sigma_mm: float | None = said("how well its place is known, one standard deviation")
    sigma_alone_mm: float | None = said("the same where the camera is solved alone")
    worst_95_mm: float | None = said("what it sees in the work volume lies no further off, in 95 % of calibrations")
    worst_95_alone_mm: float | None = said("the same where the camera is solved alone")
    from_alone_mm: float | None = said("distance of the two solutions")


class Cameras(Output):
    """Several cameras around one arm."""

    target: str = said("what was looked at")
    size_sigma: float | None = said("difference from the stated size, in standard deviations")
    held_out_px: float | None = said("residual of views that were left out of the solution")
    X_FM: Matrix = said("pose of the target in the flange, 4 x 4, m")
    cameras: list[Camera] = said("one each")
    file: str = said("file that was written")


class Board(Output):
    """A printed calibration board."""

    file: str = said("page that was written")
    paper: str = said("size of the paper")
    board: dict[str, Any] = said("the board that is in use from now on, as in board.toml")
    nominal_square_mm: float = said("side of a square as it was drawn")
    measured: bool = said("whether its width was measured on the print")


class Measured(Part):
    """A value with its interval."""

    value: float = said("the value, in the unit that the name ends with")
    within_95: float = said("half width of its 95 % interval, in the same unit")


class TouchOff(Output):
    """One touch-off."""

    table_height_mm: Measured = said("table under the base's axis")
    table_tilt_x_mm_m: Measured = said("rise of the table along X")
    table_tilt_y_mm_m: Measured = said("rise of the table along Y")
    tool_height_mm: Measured = said("how much higher the tool sits than the mount says")
    tool_forward_mm: Measured = said("how much further forward it sits")
    tool_pitch_deg: Measured = said("how much further its edge is pitched down")
    tool_roll_deg: Measured = said("how much further its left side is rolled up")
    edge_over_table_within_95_mm: float = said("half width of the 95 % interval of the edge's height over the table")
    repeat_mm: float = said("spread of touches of one place")
    misfit_mm: float = said("what touches differ by from the solution")
    slip_mm: float = said("how far the tool slipped in the hand")
    touches: int = said("touches that it rests on")
    sha256: str = said("hash of the values")
    folder: str = said("where it is stored")


class TouchOffList(Output):
    """The touch-offs of one rig and task, oldest first."""

    rig: str = said("which rig or world, and task")
    touch_offs: list[dict[str, Any]] = said(
        "each with name, created, table_height_mm, tool_height_mm, tool_forward_mm, tool_pitch_deg, tool_roll_deg, "
        "touches, in_use, restored_from; or with error"
    )
    open_sessions: list[str] = said("sessions that rest on the one in use")


class ComparedValue(Part):
    """One quantity of two touch-offs."""

    quantity: str = said("what it is")
    unit: str = said("its unit")
    first: float = said("its value in the first")
    second: float = said("its value in the second")
    difference: float = said("second less first")
    within_95: float = said("half width of the 95 % interval of the difference")


class TouchOffsCompared(Output):
    """Two touch-offs beside each other."""

    first: str = said("name of the first")
    second: str = said("name of the second")
    quantities: list[ComparedValue] = said("one each")


class Check(Part):
    """One line of the checklist."""

    group: str = said("which part of the lab")
    name: str = said("what was looked at")
    verdict: str = said("ok, advice, missing or skipped; only what is missing keeps an iteration from running")
    detail: str = said("the finding")
    fix: str = said("the remedy, as a command where there is one")


class Doctor(Output):
    """The checklist."""

    ready: bool = said("whether an iteration can run")
    hw: str = said("which hardware was looked at: fake, panda or fr3")
    task: str = said("which task")
    checks: list[Check] = said("one each")


class Setting(Part):
    """One setting."""

    value: str | int | float | bool = said("its value")
    source: str = said("where it comes from: flag, environment, project file, user file or default")


class Settings(Output):
    """Every setting with its origin."""

    settings: dict[str, Setting] = said("by name, as in adaptsim.toml")
    rig_file: dict[str, Any] | None = said("contents of the rig file; null without one")


class Places(Output):
    """Where data and settings lie."""

    data: str = said("folder of all data")
    user_file: str = said("settings of the user")
    project_file: str = said("settings of this folder")


class Initialised(Output):
    """Files that were written about the lab."""

    settings: str = said("settings file")
    settings_written: bool = said("false where there was one, which is left as it is")
    rig_file: str | None = said("rig file; null without a real arm")
    rig: dict[str, Any] | None = said("its contents")
