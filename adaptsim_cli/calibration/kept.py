"""Lists, shows and compares the calibrations of one rig."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.calibration.store import REPORT, CalibrationStore
from adaptsim_cli.storage.numbered import remark
from calib.saved import SavedCalibration

HEAD = ("calibration", "made", "known to", "")


def row(one: dict[str, Any]) -> tuple[str, ...]:
    """The columns of `HEAD`."""
    return (
        one["name"],
        str(one["created"])[:16].replace("T", " "),
        f"{one['sigma_mm']:.2f} mm, {one['sigma_deg']:.3f}°",
        remark(one["in_use"], one["restored_from"]),
    )


def compared(store: CalibrationStore, first: str, second: str) -> dict[str, Any]:
    """The differences of camera pose and joint zeros from the first to the second."""
    a, b = (store.read(store.numbered.named(name)) for name in (first, second))
    X_A, X_B = np.array(a.X_AC), np.array(b.X_AC)
    turned = np.linalg.inv(X_A[:3, :3]) @ X_B[:3, :3]
    angle_rad = float(np.arccos(np.clip((np.trace(turned) - 1.0) / 2.0, -1.0, 1.0)))
    return {
        "first": store.numbered.named(first).name,
        "second": store.numbered.named(second).name,
        "moved_mm": (1e3 * (X_B[:3, 3] - X_A[:3, 3])).tolist(),
        "distance_mm": float(1e3 * np.linalg.norm(X_B[:3, 3] - X_A[:3, 3])),
        "turned_deg": float(np.rad2deg(angle_rad)),
        "known_to_mm": float(np.hypot(a.uncertainty.sigma_mm, b.uncertainty.sigma_mm)),
        "known_to_deg": float(np.hypot(a.uncertainty.sigma_deg, b.uncertainty.sigma_deg)),
        "joint_zeros_mrad": (1e3 * (b.offsets_rad() - a.offsets_rad())).tolist(),
        "camera_late_ms": 1e3 * (b.camera_late_s() - a.camera_late_s()),
    }


def sentence(found: dict[str, Any]) -> str:
    """The comparison in words: a difference of more than three standard deviations means a moved camera."""
    apart = found["distance_mm"] > 3.0 * found["known_to_mm"] or found["turned_deg"] > 3.0 * found["known_to_deg"]
    same = "the difference lies within their uncertainty, so the camera has not moved"
    said = "the camera has moved" if apart else same
    return (
        f"{found['second']} has the camera {found['distance_mm']:.2f} mm and {found['turned_deg']:.3f}° from "
        f"{found['first']}; the two together are known to {found['known_to_mm']:.2f} mm and "
        f"{found['known_to_deg']:.3f}°: {said}"
    )


def told(known: SavedCalibration, path: Path) -> dict[str, Any]:
    """What a list says of one, for JSON."""
    report = path / REPORT
    return {
        "created": known.created,
        "camera_m": [row[3] for row in known.X_AC[:3]],
        "sigma_mm": known.uncertainty.sigma_mm,
        "sigma_deg": known.uncertainty.sigma_deg,
        "views": sum(view.used for view in known.views),
        "report": str(report) if report.is_file() else "",
    }
