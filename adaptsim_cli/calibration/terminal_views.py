"""Everything that a calibration prints for an operator, as rich renderables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from adaptsim_cli.calibration.parts import CalibrationRig
from adaptsim_cli.screen import views
from calib.coverage import Coverage
from calib.saved import SavedCalibration
from perception.board.types import BoardPose


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
    """One line for a view, and the missing coverage."""
    tilt = float(np.linalg.norm(have.tilts_deg[-1]))
    head = Text.assemble(
        (f"  {done:2d} of {total}", "bold"),
        f"  {corners:2d} of {of} corners, {pose.rms_px:.2f} px, tilt {tilt:2.0f}°, {have.distances_m[-1]:.2f} m  ",
        (picture.name, "dim"),
    )
    if not have.missing:
        return head
    return Group(head, Padding(Text(f"missing: {have.missing[0]}", style="yellow"), (0, 0, 0, 10)))


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
    checked = views.rows(("", "what", "found"), [(c.verdict, c.name, c.message) for c in everything])
    verdict = ("Accepted", "bold green") if record.accepted else ("Not accepted", "bold red")
    return Group(*lines, checked, Text.assemble(verdict))
