"""Tables of recorded trials that others wrote: CSV and Parquet, read within bounds."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hw.bounded import Unreadable, read_bytes
from hw.extras import missing
from hw.records import number_hint
from hw.types import Array
from sim.errors import ExtraMissing, RecordingsRefused

TABLE_BYTES = 512 * 2**20
MOST_ROWS = 2_000_000
MOST_CELLS = 40_000_000
"""Bounds before a table is decoded: a Parquet file of 1 MB may claim any number of rows."""

Columns = dict[str, Sequence[str | float]]


def read_columns(path: Path, required_names: Sequence[str] | None = None) -> Columns:
    """The columns of a table by name; a Parquet file gives only the `required_names`.

    Raises RecordingsRefused, ExtraMissing.
    """
    try:
        content = read_bytes(path, TABLE_BYTES)
    except FileNotFoundError as error:
        raise RecordingsRefused(f"{path} is missing") from error
    except Unreadable as error:
        raise RecordingsRefused(f"{path} {error}") from error
    except ValueError as error:  # a name with a NUL
        raise RecordingsRefused(f"{str(path)!r} cannot be the name of a file: {error}") from error
    return _parquet(path, content, required_names) if path.suffix.lower() == ".parquet" else _csv(path, content)


def require_columns(path: Path, columns: Sequence[str], required_names: Sequence[str]) -> None:
    """Raises RecordingsRefused naming the first of `required_names` that is missing."""
    if missing := [name for name in required_names if name not in columns]:
        raise RecordingsRefused(f"{path} has no column {missing[0]!r}; its columns are {', '.join(columns)}")


def _require_unique(path: Path, names: Sequence[str]) -> None:
    if len(set(names)) < len(names):
        raise RecordingsRefused(f"{path} names a column twice: {', '.join(names)}")


def numbers(path: Path, columns: Columns, name: str) -> Array:
    """(N,) the numbers of a column. Raises RecordingsRefused naming the line of a cell that is none."""
    cells = columns[name]
    try:
        values = np.array(cells, dtype=np.float64)
        if isinstance(cells, np.ndarray) or None not in cells:  # numpy would make not-a-number of an empty cell
            return values
    except (TypeError, ValueError):
        pass
    for line, cell in enumerate(cells, start=2):
        try:
            float(cell)
        except (TypeError, ValueError) as error:
            what = f"{path}, line {line}: {name} = {cell!r}"
            raise RecordingsRefused(f"{what} is not a number{number_hint(cell)}") from error
    raise RecordingsRefused(f"{path}: the column {name} holds no numbers")


def _csv(path: Path, content: bytes) -> Columns:
    try:
        text = content.decode("utf-8-sig")
        lines = list(csv.reader(io.StringIO(text, newline=""), strict=True, skipinitialspace=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise RecordingsRefused(f"{path} is no CSV table: {error}") from error
    while lines and not any(cell.strip() for cell in lines[-1]):
        lines.pop()
    if not lines:
        raise RecordingsRefused(f"{path} is empty: its first line must name the columns")
    head = [name.strip() for name in lines[0]]
    if len(head) == 1 and ";" in head[0]:
        raise RecordingsRefused(
            f"{path} separates its columns by semicolons: save it with commas between columns, and with points in "
            "numbers (1.5, not 1,5)"
        )
    _require_unique(path, head)
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(head):
            raise RecordingsRefused(f"{path}, line {number}: {len(line)} cells instead of {len(head)}")
    return {name: [line[i].strip() for line in lines[1:]] for i, name in enumerate(head)}


def _parquet(path: Path, content: bytes, required_names: Sequence[str] | None) -> Columns:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ExtraMissing(missing(str(path), "pyarrow", "export")) from error
    try:
        file = parquet.ParquetFile(io.BytesIO(content))
        names = list(file.schema_arrow.names)
        _require_unique(path, names)
        if required_names is not None:
            require_columns(path, names, required_names)
        read, rows = names if required_names is None else list(required_names), file.metadata.num_rows
        if rows > MOST_ROWS or rows * len(read) > MOST_CELLS:
            raise RecordingsRefused(
                f"{path} has {rows} rows, and {len(read)} columns are needed: at most {MOST_ROWS} rows and "
                f"{MOST_CELLS} cells are read. Keep the samples of the trials, at 10 to 100 a second"
            )
        table = file.read(columns=read)
    except (pyarrow.ArrowException, OSError, MemoryError, ValueError) as error:
        raise RecordingsRefused(f"{path} is no Parquet table: {error}") from error
    return {name: _cells(table.column(name)) for name in read}


def _cells(column: Any) -> Sequence[str | float]:
    """A column of pyarrow as numbers, or as Python's values where a cell is empty or no number."""
    import pyarrow

    is_number = pyarrow.types.is_floating(column.type) or pyarrow.types.is_integer(column.type)
    cells: Sequence[str | float] = column.to_numpy() if is_number and not column.null_count else column.to_pylist()
    return cells
