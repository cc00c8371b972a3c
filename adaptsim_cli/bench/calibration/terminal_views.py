"""Everything that a calibration shows: before and while it runs, as JSON, and beside others that are kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from adaptsim_cli.bench.calibration.parts import CalibrationRig
from adaptsim_cli.bench.calibration.store import REPORT
from adaptsim_cli.screen import views
from calib.geometry import angle_deg, distance_mm
from calib.poses import Coverage
from calib.saved import SavedCalibration
from perception.board.types import BoardPose

COLUMNS = ("known to",)
"""The columns of a list, besides name, time and remark."""


def explanation(rig: CalibrationRig, places: int | None) -> RenderableType:
    """The announcement of the series."""
    board = rig.board
    lines = (
        "Finds the camera's pose in the arm's base frame, and its uncertainty.",
        f"The board ({board.squares_across} × {board.squares_down} squares of {1e3 * board.square_m:.2f} mm) is in the "
        "gripper; the camera stays where it is.",
        (f"The arm visits {places} places" if places else "You guide the arm to about 20 places")
        + ", rests at each and takes a picture; every view is stored at once. A stopped run continues later.",
        "A camera that has just been switched on drifts: let it warm up for 40 minutes." if rig.is_real else "",
    )
    return Group(
        views.badge(rig.name, rig.title),
        Text("Camera calibration", style="bold"),
        *(Padding(Text(line), (0, 0, 0, 2)) for line in lines if line),
    )


def view(
    done: int, total: int, corners: int, of: int, pose: BoardPose, have: Coverage, picture: Path
) -> RenderableType:
    """One line for a view."""
    tilt = float(np.linalg.norm(have.tilts_deg[-1]))
    return Text.assemble(
        (f"  {done:2d} of {total}", "bold"),
        f"  {corners:2d} of {of} corners, {pose.rms_px:.2f} px, tilt {tilt:2.0f}°, {have.distances_m[-1]:.2f} m  ",
        (picture.name, "dim"),
    )


def calibration(record: SavedCalibration) -> RenderableType:
    """The result, with every check and gate in words."""
    u, used = record.uncertainty, [v for v in record.views if v.used]
    X = np.array(record.X_AC)
    where = "in the base" if record.mounting == "fixed" else "in the flange"
    held_out = "not measured" if record.held_out_px is None else f"{record.held_out_px:.2f} px"
    counted = f"{len(used)} views used, {len(record.views) - len(used)} not"
    lines = [
        Text(""),
        Text.assemble(
            (f"The camera stands at {X[0, 3]:z.4f}, {X[1, 3]:z.4f}, {X[2, 3]:z.4f} m {where}", "bold"),
            f", known to {u.sigma_mm:.2f} mm and {u.sigma_deg:.3f}° (one standard deviation)",
        ),
        Text(f"At the worst corner of the work volume it is off by less than {u.worst_95_mm:.2f} mm (95 %)"),
        Text(f"Held-out views are predicted to {held_out}; {counted}"),
        *(Text(f"  view {v.name} not used: {v.reason}", style="yellow") for v in record.views if not v.used),
    ]
    if record.joint_offsets:
        lines.append(Text(f"Joint zeros: {record.joint_offsets.reason}"))
    everything = (*record.gates, *record.checks)
    checked = views.rows(("", "what", "found"), [(c.verdict, c.name, views.with_signs(c.message)) for c in everything])
    verdict = ("Accepted", "bold green") if record.accepted else ("Not accepted", "bold red")
    return Group(*lines, checked, Text.assemble(verdict))


def summary(record: SavedCalibration) -> dict[str, Any]:
    """A calibration for JSON."""
    u = record.uncertainty
    return {
        "accepted": record.accepted,
        ("X_BC" if record.mounting == "fixed" else "X_FC"): record.X_AC,
        "sigma_mm": u.sigma_mm,
        "sigma_deg": u.sigma_deg,
        "worst_95_mm": u.worst_95_mm,
        "fit_px": record.fit_px,
        "held_out_px": record.held_out_px,
        "views_used": [view.name for view in record.views if view.used],
        "views_rejected": {view.name: view.reason for view in record.views if not view.used},
        "joint_offsets_mrad": [1e3 * float(q) for q in record.offsets_rad()],
        "target": record.board.board().name,
        "refined_intrinsics": None if record.refined_intrinsics is None else record.refined_intrinsics.model_dump(),
        "temperatures_C": record.temperatures_C,
        "uncertainty": u.model_dump(),
        "checks": [c.model_dump() for c in record.checks],
        "gates": [c.model_dump() for c in record.gates],
        "sha256": record.sha256(),
    }


def description(record: SavedCalibration, path: Path) -> Sequence[RenderableType]:
    """One calibration, and its report."""
    return calibration(record), views.FileLine("Report", path / REPORT)


def listing_row(record: SavedCalibration, path: Path) -> dict[str, Any]:
    """The row of one in a list, for JSON."""
    report = path / REPORT
    return {
        "camera_m": [row[3] for row in record.X_AC[:3]],
        "sigma_mm": record.uncertainty.sigma_mm,
        "sigma_deg": record.uncertainty.sigma_deg,
        "views": sum(view.used for view in record.views),
        "report": str(report) if report.is_file() else "",
    }


def columns(one: dict[str, Any]) -> tuple[str, ...]:
    """The values of `COLUMNS`."""
    return (f"{one['sigma_mm']:.2f} mm, {one['sigma_deg']:.3f}°",)


def compared(a: SavedCalibration, b: SavedCalibration) -> dict[str, Any]:
    """The differences of camera pose and joint zeros from the first to the second, for JSON."""
    X_A, X_B = np.array(a.X_AC), np.array(b.X_AC)
    return {
        "moved_mm": (1e3 * (X_B[:3, 3] - X_A[:3, 3])).tolist(),
        "distance_mm": distance_mm(X_A, X_B),
        "turned_deg": angle_deg(X_A, X_B),
        "known_to_mm": float(np.hypot(a.uncertainty.sigma_mm, b.uncertainty.sigma_mm)),
        "known_to_deg": float(np.hypot(a.uncertainty.sigma_deg, b.uncertainty.sigma_deg)),
        "joint_zeros_mrad": (1e3 * (b.offsets_rad() - a.offsets_rad())).tolist(),
        "camera_late_ms": 1e3 * (b.camera_late_s() - a.camera_late_s()),
    }


def comparison(row: dict[str, Any]) -> str:
    """A comparison in words: a difference of more than three standard deviations means a moved camera."""
    apart = row["distance_mm"] > 3.0 * row["known_to_mm"] or row["turned_deg"] > 3.0 * row["known_to_deg"]
    same = "the difference lies within their uncertainty, so the camera has not moved"
    conclusion = "the camera has moved" if apart else same
    return (
        f"{row['second']} has the camera {row['distance_mm']:.2f} mm and {row['turned_deg']:.3f}° from "
        f"{row['first']}; the two together are known to {row['known_to_mm']:.2f} mm and "
        f"{row['known_to_deg']:.3f}°: {conclusion}"
    )
