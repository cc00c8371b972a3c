"""Recorded trials from CSV or Parquet: one table of trials, one of samples."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from adaptsim_cli.wiring.recorded.manifest import TIME, TRIAL, RawTrial, Tables
from hw.bounded import Unreadable, read_bytes
from sim.errors import ExtraMissing, RecordingsRefused

TABLE_BYTES = 512 * 2**20

Columns = dict[str, list[str | float]]


def read_trials(folder: Path, tables: Tables) -> list[RawTrial]:
    """The trials of the two files. Raises RecordingsRefused, ExtraMissing."""
    rows, samples = read_columns(folder / tables.trials), read_columns(folder / tables.trajectories)
    ours = {theirs: name for name, theirs in tables.columns.items()}
    trial, time = tables.named(TRIAL), tables.named(TIME)
    _require(folder / tables.trials, rows, [trial, *(c for n, c in tables.columns.items() if n != TIME)])
    _require(folder / tables.trajectories, samples, [trial, time, *tables.state])
    which = np.array([str(name) for name in samples[trial]])
    numbers = np.array([_numbers(folder / tables.trajectories, samples, name) for name in (time, *tables.state)]).T
    found, names = [], [str(name) for name in rows[trial]]
    for i, name in enumerate(names):
        mine = numbers[which == name]
        if not len(mine):
            raise RecordingsRefused(f"trial {name} has no sample in {folder / tables.trajectories}")
        values = {ours.get(column, column): cells[i] for column, cells in rows.items()}
        found.append(RawTrial(name, values, mine[:, 0], mine[:, 1:]))
    if strange := sorted(set(which) - set(names)):
        raise RecordingsRefused(
            f"{folder / tables.trajectories} has samples of trial {strange[0]}, which is not listed"
        )
    return found


def read_columns(path: Path) -> Columns:
    """The columns of a table by name. Raises RecordingsRefused, ExtraMissing."""
    try:
        content = read_bytes(path, TABLE_BYTES)
    except FileNotFoundError as error:
        raise RecordingsRefused(f"{path} is missing") from error
    except Unreadable as error:
        raise RecordingsRefused(f"{path} {error}") from error
    if path.suffix == ".parquet":
        return _parquet(path, content)
    try:
        lines = list(csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingsRefused(f"{path} is no CSV table: {error}") from error
    if not lines:
        raise RecordingsRefused(f"{path} is empty: its first line must name the columns")
    head = lines[0]
    if len(set(head)) < len(head):
        raise RecordingsRefused(f"{path} names a column twice: {', '.join(head)}")
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(head):
            raise RecordingsRefused(f"{path}, line {number}: {len(line)} cells instead of {len(head)}")
    return {name: [line[i] for line in lines[1:]] for i, name in enumerate(head)}


def _parquet(path: Path, content: bytes) -> Columns:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ExtraMissing(f"{path} needs the package pyarrow: pip install 'adaptsim[export]'") from error
    try:
        found: Columns = parquet.read_table(io.BytesIO(content)).to_pydict()
    except (pyarrow.ArrowException, OSError) as error:
        raise RecordingsRefused(f"{path} is no Parquet table: {error}") from error
    return found


def _require(path: Path, columns: Columns, wanted: list[str]) -> None:
    if missing := [name for name in wanted if name not in columns]:
        raise RecordingsRefused(f"{path} has no column {missing[0]!r}; its columns are {', '.join(columns)}")


def _numbers(path: Path, columns: Columns, name: str) -> list[float]:
    found = []
    for line, cell in enumerate(columns[name], start=2):
        try:
            found.append(float(cell))
        except (TypeError, ValueError) as error:
            raise RecordingsRefused(f"{path}, line {line}: {name} = {cell!r} is no number") from error
    return found
