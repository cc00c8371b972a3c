"""The log of a pretraining: curves and times."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from sim.errors import DatasetError
from sim.storage.files import read_toml, whole_file, write_toml

Log = Callable[[Sequence[float]], None]
"""Takes the next row of a learning curve."""


def silent(row: Sequence[float]) -> None:
    """A log that stores nothing."""


def curve_file(path: Path, columns: Sequence[str]) -> Log:
    """A log that keeps the curve so far in a CSV file, which can be watched during the training."""
    rows: list[Sequence[float]] = []

    def add(row: Sequence[float]) -> None:
        rows.append(row)
        with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(("round", *columns))
            table.writerows((number, *values) for number, values in enumerate(rows, start=1))

    return add


TIMINGS = "timings.toml"

EVERY_S = 5.0
"""Time between two writes of the file: the most that an interruption can lose."""


class StageTimer:
    """Passes on the progress of stages; the time since the last call counts for the reported stage.

    Not for subclassing.
    """

    def __init__(
        self,
        folder: Path,
        passed_on: Callable[[str, int, int], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._path, self._passed_on, self._clock = folder / TIMINGS, passed_on, clock
        self._seconds = wall_times_s(folder)
        self._last = self._stored = clock()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Count the time since the last call for `stage`, and pass the report on."""
        now = self._clock()
        self._seconds[stage] = self._seconds.get(stage, 0.0) + now - self._last
        self._last = now
        if done >= total or now - self._stored >= EVERY_S:
            write_toml(self._path, {"seconds": self._seconds})
            self._stored = now
        self._passed_on(stage, done, total)


def wall_times_s(folder: Path) -> dict[str, float]:
    """Seconds by name of the stage; empty if nothing was measured. Raises DatasetError on a damaged file."""
    path = folder / TIMINGS
    if not path.exists():
        return {}
    try:
        return {str(stage): float(seconds) for stage, seconds in read_toml(path)["seconds"].items()}
    except (KeyError, AttributeError, TypeError, ValueError) as error:
        raise DatasetError(f"{path} cannot be read ({error}): remove it; only the wall times are lost") from error
