"""Data sets of robot learning as recorded trials, one for each episode: LeRobot (Parquet) and robomimic (HDF5)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.session.recorded.manifest import LeRobot, RawTrial, Robomimic
from adaptsim_cli.session.recorded.tables import MOST_ROWS, numbers, read_columns
from hw.bounded import Unreadable, require_file
from hw.extras import missing
from hw.types import Array
from sim.errors import ExtraMissing, RecordingsRefused

HDF5_BYTES = 8 * 2**30
_PART = re.compile(r"([^\[\]]+)(?:\[([0-9]{1,6})\])?")


def of_lerobot(folder: Path, source: LeRobot) -> list[RawTrial]:
    """The episodes of a LeRobot data set. Raises RecordingsRefused, ExtraMissing."""
    if not (paths := sorted(folder.glob(source.files))):
        raise RecordingsRefused(f"no file in {folder} is called {source.files}")
    sources = (*source.state, *source.fields.values())
    columns = list(dict.fromkeys(["episode_index", "timestamp", *(_split(folder, where)[0] for where in sources)]))
    trials = list[RawTrial]()
    for path in paths:
        cells = read_columns(path, columns)
        episodes, t_s = numbers(path, cells, "episode_index"), numbers(path, cells, "timestamp")
        series = {where: _series(path, cells[_split(path, where)[0]], where) for where in sources}
        for episode in np.unique(episodes):
            rows = np.flatnonzero(episodes == episode)
            values = {name: float(series[where][rows[0]]) for name, where in source.fields.items()}
            state = np.stack([series[where][rows] for where in source.state], axis=-1)
            trials.append(RawTrial(f"episode {episode:g}", values, t_s[rows], state))
    return trials


def of_robomimic(folder: Path, source: Robomimic) -> list[RawTrial]:
    """The demonstrations of robomimic files, one step every 1 / `rate_hz` seconds.

    Raises RecordingsRefused, ExtraMissing.
    """
    if not (paths := sorted(folder.glob(source.files))):
        raise RecordingsRefused(f"no file in {folder} is called {source.files}")
    trials = list[RawTrial]()
    for path in paths:
        with _opened(path) as file:
            if "data" not in file:
                raise RecordingsRefused(f"{path} has no group 'data', so it is not a robomimic data set")
            for name in sorted(file["data"], key=lambda one: (len(one), one)):
                demo = file["data"][name]
                read = {where: _dataset(path, demo, where) for where in (*source.state, *source.fields.values())}
                state = np.stack([read[where] for where in source.state], axis=-1)
                values = {ours: float(read[where][0]) for ours, where in source.fields.items()}
                trials.append(RawTrial(f"{path.stem}/{name}", values, np.arange(len(state)) / source.rate_hz, state))
    return trials


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        import h5py
    except ImportError as error:
        raise ExtraMissing(missing(str(path), "h5py", "hdf5")) from error
    try:
        require_file(path, HDF5_BYTES)
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, KeyError, ValueError, RuntimeError, TypeError, AttributeError, Unreadable) as error:
        raise RecordingsRefused(f"{path} is not a readable robomimic data set: {error}") from error


def _dataset(path: Path, demo: Any, where: str) -> Array:
    """(N,) a column of a data set of one demonstration, or the only value of an attribute."""
    name, _ = _split(path, where)
    if name.startswith("attrs/"):
        return np.atleast_1d(np.asarray(demo.attrs[name.removeprefix("attrs/")], dtype=np.float64))
    content = demo[name]
    if content.shape[0] > MOST_ROWS or content.is_virtual or content.external:
        raise ValueError(f"{name} has {content.shape[0]} steps, or lies in another file")
    return _series(path, content[()], where)


def _series(path: Path, cells: Sequence[Any], where: str) -> Array:
    """(N,) the numbers at `name` or `name[i]`. Raises RecordingsRefused."""
    _, index = _split(path, where)
    try:
        values = np.array([cell if index is None else cell[index] for cell in cells], dtype=np.float64)
    except (TypeError, ValueError, IndexError) as error:
        raise RecordingsRefused(f"{path}: {where} is not a number in every row: {error}") from error
    if values.ndim != 1:
        raise RecordingsRefused(f"{path}: {where} has {values.shape[1]} numbers in each row: name one, e.g. {where}[0]")
    return values


def _split(path: Path, where: str) -> tuple[str, int | None]:
    matched = _PART.fullmatch(where)
    if matched is None:
        raise RecordingsRefused(f"{path}: {where!r} names no column: write a name, or a name with an index in brackets")
    return matched[1], None if matched[2] is None else int(matched[2])
