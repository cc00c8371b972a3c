"""Reads, solves, shows and writes folders of several cameras around one arm."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from adaptsim_cli.calibration import sights
from adaptsim_cli.screen import views
from calib import files
from calib.errors import UnusableViews
from calib.several import Camera, Together, solve_together


def solve(folders: Sequence[Path]) -> Together:
    """Raises ViewFolderError, PerceptionError, UnusableViews."""
    names = [folder.name for folder in folders]
    if len(set(names)) < len(names):
        raise UnusableViews(
            f"two folders have the same name ({', '.join(names)}): a camera takes the name of its folder"
        )
    return solve_together([_camera(folder) for folder in folders])


def _camera(folder: Path) -> Camera:
    stored = files.read_folder(folder)
    looked = sights.look(stored)
    return Camera(folder.name, looked.views, looked.setup, stored.forward)


def show(found: Together) -> RenderableType:
    """A table with one row per camera."""
    head = ("camera", "at, m in the base", "views", "held out", "alone", "work volume", "alone")
    rows = [
        (
            c.name,
            ", ".join(f"{v:.4f}" for v in c.X_BC[:3, 3]),
            str(len(c.used)),
            f"{c.held_out_px:.2f} px",
            f"{c.alone_held_out_px:.2f} px",
            f"{c.work_95_mm:.1f} mm",
            f"{c.alone_work_95_mm:.1f} mm",
        )
        for c in found.cameras
    ]
    size = f", its size found to ± {100 * found.size_sigma:.2f} %" if found.size_sigma else ""
    return Group(
        Text(f"{len(found.cameras)} cameras, one {found.target}{size}", style="bold"),
        Text(f"Held-out views are predicted to {found.held_out_px:.2f} px"),
        views.rows(head, rows),
        Text("work volume: 95 % of calibrations are better than this at its worst corner"),
    )


def as_json(found: Together) -> dict[str, Any]:
    """The result for JSON."""
    return {
        "target": found.target,
        "size_sigma": found.size_sigma,
        "held_out_px": found.held_out_px,
        "X_FM": found.X_FM.tolist(),
        "cameras": [
            {
                "name": c.name,
                "X_BC": c.X_BC.tolist(),
                "views_used": list(c.used),
                "fit_px": c.fit_px,
                "held_out_px": c.held_out_px,
                "held_out_alone_px": c.alone_held_out_px,
                "sigma_mm": c.sigma_mm,
                "sigma_alone_mm": c.alone_sigma_mm,
                "worst_95_mm": c.work_95_mm,
                "worst_95_alone_mm": c.alone_work_95_mm,
                "from_alone_mm": c.from_alone_mm,
            }
            for c in found.cameras
        ],
    }


def content(found: Together) -> bytes:
    """The content of together.json."""
    return (json.dumps(as_json(found), indent=1, allow_nan=False) + "\n").encode()
