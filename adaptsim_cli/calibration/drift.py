"""`calibrate check`: three views against the calibration in use."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptsim_cli.calibration.parts import CalibrationRig
from adaptsim_cli.calibration.taking import ViewRefused, look
from adaptsim_cli.calibration.visits import Arrival, Visits
from adaptsim_cli.screen.console import Screen
from calib import files
from calib.drift import MIN_VIEWS, Known, drift
from calib.saved import SavedCalibration
from calib.types import Drift, View
from perception.errors import BoardNotFound


def check(rig: CalibrationRig, known: SavedCalibration, visits: Visits, screen: Screen) -> Drift:
    """Take three views and compare.

    Stores nothing. Raises TooFewViews, HardwareError, PerceptionError, StoppedByOperator.
    """
    from perception.board import detect

    camera = rig.camera.model().colour
    setup = files.as_setup(files.setup_record(rig.camera.model(), rig.board, rig.arm.model))
    views: list[View] = []
    visits.begin()
    for number in visits.numbers(frozenset()):
        if visits.go(number, None) is not Arrival.THERE:
            continue
        try:
            seen = look(rig)
            corners = detect(seen.frame.colour, rig.board, camera)
        except (ViewRefused, BoardNotFound) as error:
            screen.note(f"  place {number + 1} left out: {error}")
            continue
        views.append(View(f"{number + 1:03d}", corners, q_rad=seen.q_rad))
        screen.show(f"  {len(views)} of {MIN_VIEWS}  {len(corners)} of {rig.board.corners} corners")
        if len(views) == MIN_VIEWS:
            break
    visits.end(lambda: None)
    joint_rad = float("nan") if known.joint_rad is None else known.joint_rad
    was = Known(np.array(known.X_AC), np.array(known.X_HM), known.offsets_rad(), joint_rad)
    return drift(views, setup, rig.flange, was)


def as_json(found: Drift) -> dict[str, Any]:
    """The comparison for `calibrate check --json`; `X_BC_now` is 4 x 4, in metres."""
    return {
        "moved": found.moved,
        "rms_px": found.rms_px,
        "limit_px": found.limit_px,
        "moved_mm": found.moved_mm,
        "moved_deg": found.moved_deg,
        "sigma_mm": found.sigma_mm,
        "sigma_deg": found.sigma_deg,
        "X_BC_now": found.X_AC.tolist(),
        "message": found.message,
    }
