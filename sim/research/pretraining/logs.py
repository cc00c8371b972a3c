"""What a pretraining writes down about itself: curves and times."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tensorboardX import SummaryWriter

from sim.errors import DatasetError
from sim.storage.files import read_toml, write_toml

Log = Callable[[str, float, int], None]
"""(name, value, step)"""


def silent(name: str, value: float, step: int) -> None:
    """A log that stores nothing."""


@contextmanager
def tensorboard(folder: Path) -> Iterator[Log]:
    """Write event files for TensorBoard into `folder`: `tensorboard --logdir FOLDER`."""
    with SummaryWriter(logdir=str(folder)) as writer:
        yield writer.add_scalar


TIMINGS = "timings.toml"

EVERY_S = 5.0
"""Time between two writes of the file: the most that an interruption can lose."""


class Stopwatch:
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
