"""One calibration on the toy bench, for a disk that fails.

What is computed of the same bytes is computed once: pictures, corners, the solution of a folder of views and its
report. The stamps of the pictures follow from the places, so that a series that was taken up again is the same.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import board_rig
import numpy as np
from board_rig import COUNT, ToyBench, picture, places
from failing_disk import main
from numpy.typing import NDArray

import perception.board
from adaptsim_cli.bench.calibration import flow, page, pictures
from adaptsim_cli.bench.calibration.solving import SolvedFolder, solve_folder
from adaptsim_cli.bench.calibration.store import RESULT, VIEWS
from adaptsim_cli.storage.durable import LOCK
from calib import files
from hw.types import Execution, JointPath

BETWEEN_S = 10.0
"""From place to place."""


@dataclass
class StampedBench(ToyBench):
    """Its clock says where the arm is, and it stands there to the last digit from wherever it came."""

    def execute(self, path: JointPath) -> Execution:
        played = super().execute(path)
        if (at := np.flatnonzero(np.abs(places(COUNT) - self.q_rad).max(axis=1) < 1e-9)).size:
            self.t_s, self.q_rad = BETWEEN_S * (1 + int(at[0])), places(COUNT)[at[0]]
        return played


def once(compute: Callable[..., Any], key: Callable[..., Any]) -> Callable[..., Any]:
    """`compute`, and what it came to before where the key is the same; errors are not kept."""
    known: dict[Any, Any] = {}

    def computed(*arguments: Any, **named: Any) -> Any:
        of = key(*arguments, **named)
        if of not in known:
            known[of] = compute(*arguments, **named)
        return known[of]

    return computed


def _of_folder(folder: Path, **_: Any) -> str:
    read = (path for path in sorted(folder.iterdir()) if path.suffix != ".jpg")  # pictures are for people alone
    return _sha256(*(part for path in read for part in (path.name.encode(), path.read_bytes())))


def _of_solved(solved: SolvedFolder) -> str:
    return _sha256(solved.record.content())


def _sha256(*parts: bytes) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()


def _of_image(image: NDArray[np.uint8], *_: Any) -> str:
    return _sha256(image.tobytes(), str((image.shape, image.dtype)).encode())


class ToyCalibration:
    def __init__(self) -> None:
        vars(board_rig)["picture"] = once(picture, lambda X, board, seed: (X.tobytes(), board, seed))
        solve = once(solve_folder, _of_folder)
        vars(flow)["solve_folder"] = lambda folder, **named: _in(folder, solve(folder, **named))
        vars(page)["render"] = once(page.render, _of_solved)
        vars(pictures)["draw_arm"] = once(pictures.draw_arm, _of_solved)
        vars(perception.board)["detect"] = once(perception.board.detect, _of_image)
        vars(files)["_png"] = once(vars(files)["_png"], _of_image)

    def run(self, home: Path) -> None:
        with board_rig.store(home).locked():
            board_rig.run(home, StampedBench())

    def completed(self, home: Path) -> dict[str, bytes]:
        """Every view that has its record, and the calibration."""
        folder = home / "calibrations" / "toy"
        views = {path.stem for path in folder.glob(f"{VIEWS}*/{files.PREFIX}*.json")}
        counts = [path for path in folder.glob(f"{VIEWS}*/{files.PREFIX}*") if path.name.partition(".")[0] in views]
        found = [*counts, *folder.glob(f"{RESULT}*/*")]
        return {str(path.relative_to(home)): path.read_bytes() for path in found}

    def is_over(self, home: Path) -> bool:
        """After it, the same command would begin the next calibration."""
        return any((home / "calibrations" / "toy").glob(f"{RESULT}*"))

    def digest(self, home: Path) -> dict[str, object]:
        return {
            str(path.relative_to(home)): json.loads(content) if path.suffix == ".json" else _sha256(content)
            for path in sorted(home.rglob("*"))
            if path.is_file() and path.name != LOCK
            for content in [path.read_bytes()]
        }

    def damage(self, home: Path) -> tuple[str, ...]:
        return files.read_folder(home / "calibrations" / "toy" / f"{VIEWS}0001").damaged


def _in(folder: Path, solved: SolvedFolder) -> SolvedFolder:
    """The same in another home."""
    return replace(solved, images={name: folder / path.name for name, path in solved.images.items()})


if __name__ == "__main__":
    main(ToyCalibration())
