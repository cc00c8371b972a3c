"""Rows for a person and for pandas, and drawings that a notebook shows."""

from __future__ import annotations

import io
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from adaptsim_cli.session.exporting import Row
from adaptsim_cli.storage import durable
from hw.extras import missing
from sim.errors import ExtraMissing

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

SHOWN = 30
"""Rows that are shown; the list has all of them."""

WIDEST, LONGEST = 120, 40
"""Characters of a printed line, and of one of its cells."""


class Rows(list[Row]):
    """A list of flat rows (name -> number or word) that is shown as a table, printed or in a notebook."""

    def to_pandas(self) -> DataFrame:
        """The rows as a data frame. Raises ExtraMissing without pandas."""
        return data_frame(list(self))

    @property
    def columns(self) -> list[str]:
        """The names in any row, in their order."""
        return list(dict.fromkeys(name for row in self for name in row))

    def __repr__(self) -> str:
        if not self:
            return "no rows"
        names, shown = self.columns, self[:SHOWN]
        cells = [[name, *(_clipped(_in_short(row.get(name, ""))) for row in shown)] for name in names]
        padded = [[cell.ljust(max(map(len, column))) for cell in column] for column in cells]
        while len(padded) > 1 and sum(len(column[0]) + 2 for column in padded) > WIDEST:
            padded.pop()
        lines = ["  ".join(line).rstrip() for line in zip(*padded, strict=True)]
        rest = [(len(self) - len(shown), "row"), (len(names) - len(padded), "column")]
        return "\n".join([*lines, *(f"… and {count} more {what}{'s' * (count != 1)}" for count, what in rest if count)])

    def _repr_html_(self) -> str:
        columns = self.columns
        more = f"<p>… and {len(self) - SHOWN} more rows</p>" if len(self) > SHOWN else ""
        return html_table(columns, [[row.get(name, "") for name in columns] for row in self[:SHOWN]]) + more


@dataclass(frozen=True, eq=False)
class Plot:
    """A drawing. A notebook shows it; a script saves it."""

    figure: Figure  # of matplotlib, to change anything

    def save(self, path: Path | str, dpi: int = 150) -> Path:
        """Write it as PNG, PDF or SVG, by its suffix, and return the path. Raises ValueError for other suffixes."""
        path = Path(path)
        durable.make_folder(path.absolute().parent)
        durable.replace_file(path.absolute(), self._content(path.suffix.lstrip(".") or "png", dpi))
        return path

    def _repr_png_(self) -> bytes:
        return self._content("png", 90)

    def _content(self, kind: str, dpi: int) -> bytes:
        content = io.BytesIO()
        self.figure.savefig(content, format=kind, dpi=dpi)
        return content.getvalue()


def empty_figure(width_in: float, height_in: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """A figure of matplotlib without a window. Raises ExtraMissing without matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ExtraMissing(missing("a plot", "matplotlib", "plot")) from error
    return Figure(figsize=(width_in, height_in), layout=layout)


def data_frame(columns: Any) -> DataFrame:
    """A data frame of rows, or of columns by name. Raises ExtraMissing without pandas."""
    try:
        import pandas as pd
    except ImportError as error:
        raise ExtraMissing(missing("a data frame", "pandas", "pandas")) from error
    return pd.DataFrame(columns)


def html_table(head: list[str], body: list[list[Any]]) -> str:
    """A table for a notebook; numbers are rounded to four digits."""
    cells = "".join(f"<th>{escape(name)}</th>" for name in head)
    rows = ("".join(f"<td>{escape(_in_short(value))}</td>" for value in row) for row in body)
    return f"<table><thead><tr>{cells}</tr></thead><tbody>{''.join(f'<tr>{row}</tr>' for row in rows)}</tbody></table>"


def _clipped(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"


def _in_short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
