"""Stores calibrations in `<data>/calibrations/<rig>/` and never overwrites one.

views-0001/        setup.toml, view-*.json with images: one series, continued until it has given a calibration
calibration-0001/  calibration.json and report.html, written whole or not at all; the highest number counts
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from adaptsim_cli.storage import durable
from adaptsim_cli.storage.durable import locked
from adaptsim_cli.storage.numbered import Numbered, NumberedRecords
from calib import files
from calib.errors import ViewFolderError
from calib.records import SetupRecord, read
from calib.saved import FILE, SavedCalibration

VIEWS, RESULT, REPORT, MOTION = "views-", "calibration-", "report.html", "motion.json"


@dataclass(frozen=True)
class Series:
    """A folder of views that grows."""

    folder: Path

    @property
    def setup(self) -> SetupRecord:
        """The board and the camera of the series. Raises ViewFolderError."""
        return read(SetupRecord, self.folder / files.SETUP)

    @property
    def has_views(self) -> bool:
        """Whether at least one view is stored."""
        return any(self.folder.glob(f"{files.PREFIX}*.json"))

    @property
    def has_motion(self) -> bool:
        """Whether the film for the time offset is stored."""
        return (self.folder / MOTION).exists()

    def add(self, view_files: Mapping[str, bytes]) -> None:
        """Write the files of one view; its record comes last and makes it count. Raises DiskFull, SessionError.

        Images of an unfinished view are replaced. An existing record of that name is a damaged one and is set aside.
        """
        *images, (record, content) = view_files.items()
        if (self.folder / record).exists():
            (self.folder / record).rename(self.folder / f"{record}.damaged")
        for name, data in images:
            durable.replace_file(self.folder / name, data)
        durable.write_file(self.folder / record, content)

    def path_of_picture(self, view: str) -> Path:
        """The file with the picture of a view and its corners."""
        return self.folder / f"{view}.corners.jpg"

    def picture(self, name: str, jpeg: bytes) -> Path:
        """A picture for people, beside the views."""
        path = self.folder / name
        durable.replace_file(path, jpeg)
        return path

    @property
    def has_touch(self) -> bool:
        """Whether touched points are stored."""
        return (self.folder / files.TOUCH).exists()

    def write_touch(self, touch_files: Mapping[str, bytes]) -> None:
        """Store touched points: the image first, because the record makes them count."""
        for name, data in touch_files.items():
            durable.replace_file(self.folder / name, data)

    def set_aside_touch(self) -> None:
        """Rename the touched points; the next run asks for new ones."""
        (self.folder / files.TOUCH).replace(self.folder / f"{files.TOUCH}.refused")

    def write_motion(self, content: Mapping[str, Any]) -> None:
        """Store the film for the time offset, whole or not at all. Raises DiskFull."""
        durable.replace_file(self.folder / MOTION, json.dumps(content).encode())


class CalibrationStore(NumberedRecords[SavedCalibration]):
    """All calibrations of one rig."""

    kind, file, prefix, command = SavedCalibration, FILE, RESULT, "calibrate"

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock this rig against other calibrations and checks. Raises UsageError if one is running."""
        durable.make_folder(self.folder)
        refusal = (
            f"another calibration of this rig ({self.folder.name}) is running; wait until it has ended, or stop it: "
            "its views are kept"
        )
        with locked(self.folder, refusal):
            durable.remove_leftovers(self.folder)
            yield

    def series(self, setup: SetupRecord, *, fresh: bool) -> tuple[Series, bool]:
        """The series to continue, and whether it already existed.

        It is a new one if `fresh`, if the last one has given a calibration, or if the setup has changed since then.
        """
        folders = self._series.all()
        if folders and not fresh and not self._finished(folders[-1]) and _same(folders[-1], setup):
            return Series(folders[-1]), True
        path = self._series.next()
        durable.make_folder(self.folder)
        durable.write_folder(path, {files.SETUP: files.setup_file(setup)})
        return Series(path), False

    def save(self, record: SavedCalibration, report: bytes) -> Path:
        """Store an accepted calibration, which becomes the current one; return its folder."""
        return self.add({FILE: record.content(), REPORT: report})

    def _finished(self, series: Path) -> bool:
        return any(read(SavedCalibration, path / FILE).folder == series.name for path in self.numbered.all())

    @property
    def _series(self) -> Numbered:
        return Numbered(self.folder, VIEWS)


def _same(folder: Path, setup: SetupRecord) -> bool:
    try:
        return read(SetupRecord, folder / files.SETUP) == setup
    except ViewFolderError:
        return False
