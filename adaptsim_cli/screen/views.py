"""What is shown, as rich renderables; pure, so that `console` alone touches the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich import box
from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from adaptsim_cli.config import is_simulated
from adaptsim_cli.screen.checks import Readiness
from hw.types import Array
from sim.types import Space


def number(value: float) -> str:
    """Three significant digits, plain where that reads well."""
    if value == 0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{value:.2e}"


def values(space: Space, point: Array) -> str:
    """A point of a space in words: the plain name of every dimension with its value and unit."""
    return ", ".join(
        f"{d.plain_name} {number(v)}{' ' + d.unit if d.unit else ''}"
        for d, v in zip(space.dimensions, point, strict=True)
    )


def meanings(*spaces: Space) -> Table:
    """Name, plain name, unit and meaning of every dimension of the spaces."""
    dimensions = [d for space in spaces for d in space.dimensions]
    return rows(("name", "plain name", "unit", "meaning"), [(d.name, d.plain, d.unit, d.meaning) for d in dimensions])


def badge(hw: str, hardware: str) -> Text:
    """Which hardware moves; on every screen."""
    if is_simulated(hw):
        return Text.assemble((" SIMULATED ", "black on cyan"), f" {hardware}: no real robot moves")
    return Text.assemble((" REAL ROBOT ", "white on red"), f" {hardware}: keep clear of the arm")


def checks(found: Sequence[Readiness]) -> RenderableType:
    """The checklist before a session, one row a check."""
    table = _table()
    for check in found:
        table.add_row(Text("ok", "green") if check.ok else Text("FAILED", "bold red"), check.name, check.detail)
    return indent(table)


def rows(head: Sequence[str], body: Iterable[Sequence[str]], right: Sequence[int] = ()) -> Table:
    """A plain table: `right` names the columns with numbers."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for index, name in enumerate(head):
        table.add_column(name, justify="right" if index in right else "left", overflow="fold")
    for cells in body:
        table.add_row(*(Text(cell) for cell in cells))
    return table


def _table() -> Table:
    return Table(box=None, show_header=False, pad_edge=False)


def indent(what: RenderableType) -> Padding:
    """Two columns in from the left."""
    return Padding(what, (0, 0, 0, 2), expand=False)
