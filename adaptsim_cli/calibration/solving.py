"""From a folder of views to a record: detect, solve, check, judge, in this order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from adaptsim_cli.calibration import checking
from calib import files
from calib.errors import TooFewViews
from calib.records import SetupRecord
from calib.saved import Origin, SavedCalibration, record_calibration
from calib.types import Forward, Setup, View
from perception.board.types import Corners
from perception.errors import BoardNotFound

DEVICES = ("arm", "camera")
"""Whose temperatures are kept with a calibration, where they tell them."""


@dataclass(frozen=True, eq=False)
class Solved:
    """What came of a folder, with what the report shows beside the record."""

    record: SavedCalibration
    setup: Setup
    views: tuple[View, ...]
    images: Mapping[str, Path]  # by the view's name
    not_seen: tuple[str, ...]  # sentences: views without a board, damaged ones


def solve_folder(folder: Path, *, hw: str, created: str, versions: Mapping[str, str]) -> Solved:
    """Raises ViewFolderError, WrongBoard, BoardMirrored, CalibrationError."""
    from calib.gates import judge
    from calib.solve import solve

    stored = files.read_folder(folder)
    setup = files.as_setup(stored.setup)
    seen, not_seen = detected(stored, setup)
    forward = kinematics(stored.setup)
    solution = solve(list(seen), setup, forward)
    checks = checking.checks(folder, stored, setup, seen, solution, forward)
    origin = Origin(
        folder=folder.name,  # by its name alone, so that the data folder can be moved
        view_sha256={view.name: view.sha256 for view in stored.views},
        hw=hw,
        arm=stored.setup.arm,
        camera=stored.setup.serial,
        created=created,
        source=_source(hw, created),
        versions=versions,
        temperatures_C={device: _median(checking.readings(stored, device)) for device in DEVICES},
    )
    record = record_calibration(
        solution, setup.p_AP_m, stored.setup.board, checks, judge(solution, setup, checks), origin
    )
    images = {view.name: folder / view.record.image for view in stored.views}
    return Solved(record, setup, seen, images, (*stored.damaged, *not_seen))


def detected(stored: files.Folder, setup: Setup) -> tuple[tuple[View, ...], tuple[str, ...]]:
    """The views with a board, and sentences about the others. Raises WrongBoard, BoardMirrored, TooFewViews."""
    from perception.board import detect

    views: list[View] = []
    without: list[str] = []
    for view in stored.views:
        try:
            corners = detect(view.colour, setup.board, setup.colour)
        except BoardNotFound as error:
            without.append(f"view {view.name}: {error}")
            continue
        views.append(
            View(
                name=view.name,
                corners=corners,
                q_rad=view.q_rad,
                X_BF=view.X_BF,
                infrared=_infrared(view, setup),
                t_camera_s=view.record.t_camera_s,
                t_arm_s=view.record.t_arm_s,
            )
        )
    if not views:
        raise TooFewViews(f"none of {len(stored.views)} views shows the board: {without[0]}")
    return tuple(views), tuple(without)


def _median(values: list[float]) -> float | None:
    return median(values) if values else None


def kinematics(setup: SetupRecord) -> Forward | None:
    """Of the arm that the views name; None where they give poses."""
    from hw.kinematics import forward

    return None if setup.arm == "other" else forward


def _infrared(view: files.StoredView, setup: Setup) -> Corners | None:
    from perception.board import detect

    if view.infrared is None or setup.infrared is None:
        return None
    try:
        return detect(view.infrared, setup.board, setup.infrared)
    except BoardNotFound:
        return None  # the infrared image is a check of its own, not a condition


def _source(hw: str, created: str) -> str:
    where = {"fake": "of the simulated lab", "recorded": "from recorded views"}.get(hw, f"of the {hw}")
    return f"calibration {where}, {created[:10]}"
