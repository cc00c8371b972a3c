"""From a folder of views to a record: detect, solve, check, judge, in this order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from adaptsim_cli.calibration import checking, sights
from calib import files
from calib.records import SetupRecord
from calib.saved import Origin, SavedCalibration, saved
from calib.types import Setup, View

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
    recognised: tuple[str, ...]  # sentences: what of the folder was found rather than told


def solve_folder(folder: Path, *, hw: str, created: str, versions: Mapping[str, str]) -> Solved:
    """Raises ViewFolderError, PerceptionError where no view shows the board, CalibrationError."""
    from calib.gates import judge
    from calib.sizing import solve_any_size

    stored = files.read_folder(folder)
    looked = sights.look(stored)
    seen, forward = looked.views, stored.forward
    solution, setup = solve_any_size(list(seen), looked.setup, forward)
    target = stored.setup.board.scaled(setup.board.spacing_m / looked.setup.board.spacing_m)
    checks = checking.checks(folder, stored, setup, seen, solution, forward)
    origin = Origin(
        folder=folder.name,  # by its name alone, so that the data folder can be moved
        view_sha256={view.name: view.sha256 for view in stored.views},
        hw=hw,
        arm=stored.setup.arm,
        camera=stored.setup.serial,
        created=created,
        source=_source(stored.setup, hw, created),
        versions=versions,
        temperatures_C={device: _median(checking.readings(stored, device)) for device in DEVICES},
    )
    record = saved(solution, setup.p_AP_m, target, checks, judge(solution, setup, checks), origin)
    images = {view.name: folder / view.record.image for view in stored.views if view.record.image is not None}
    return Solved(record, setup, seen, images, (*stored.damaged, *looked.left_out), looked.recognised)


def _median(values: list[float]) -> float | None:
    return median(values) if values else None


def _source(setup: SetupRecord, hw: str, created: str) -> str:
    where = {"fake": "of the simulated lab", "recorded": "from recorded views"}.get(hw, f"of the {hw}")
    return f"calibration {where}, {created[:10]}"
