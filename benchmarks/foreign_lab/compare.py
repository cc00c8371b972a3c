"""Truth against belief: what the program said of camera, table and tool, beside what the room was built with."""

from __future__ import annotations

from typing import Any

import numpy as np
from world import Truth, camera_pose, table_height_m


def calibration(said: dict[str, Any], truth: Truth) -> dict[str, Any]:
    """The camera's pose, the joints' zeros, and what the program took its error to be."""
    X = np.array(said["X_BC"] if "X_BC" in said else said["X_AC"])
    true = camera_pose(truth)
    apart = X[:3, :3].T @ true[:3, :3]
    turned = np.degrees(np.arccos(np.clip((np.trace(apart) - 1.0) / 2.0, -1.0, 1.0)))
    off_mm = 1e3 * (X[:3, 3] - true[:3, 3])
    work = [
        1e3 * float(np.linalg.norm((X @ np.linalg.inv(true) @ [x, y, 0.02, 1.0])[:3] - [x, y, 0.02]))
        for x in (0.6, 0.8, 1.0)
        for y in (-0.2, 0.2)
    ]
    return {
        "off_mm": float(np.linalg.norm(off_mm)),
        "turned_deg": float(turned),
        "worst_work_mm": max(work),
        "stated_worst_95_mm": said.get("worst_95_mm"),
        "joint_offsets_mrad": said.get("joint_offsets_mrad"),
        "true_offsets_mrad": [1e3 * v for v in truth.joint_zero_rad],
        "views_used": len(said.get("views_used", [])),
        "views_rejected": said.get("views_rejected"),
        "checks": {c["name"]: [c["verdict"], c["message"]] for c in said.get("checks", [])},
    }


def touch_off(said: dict[str, Any], truth: Truth) -> dict[str, Any]:
    """Table and tool as believed, with what is true."""
    true = {
        "table_height_mm": 1e3 * table_height_m(truth, 0.68, 0.0),
        "table_tilt_x_mm_m": 1e3 * truth.table_slope[0],
        "table_tilt_y_mm_m": 1e3 * truth.table_slope[1],
        "tool_height_mm": 1e3 * truth.tool_height_m,
        "tool_forward_mm": 1e3 * truth.tool_forward_m,
        "tool_pitch_deg": float(np.degrees(truth.tool_pitch_rad)),
        "tool_roll_deg": float(np.degrees(truth.tool_roll_rad)),
    }
    return {name: {"true": value, "believed": said[name]} for name, value in true.items()}
