"""Common views as rich renderables. Pure: only `console` touches the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from rich import box
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from adaptsim_cli.config import is_simulated
from adaptsim_cli.screen.checks import Readiness
from adaptsim_cli.screen.values import number, quantity
from hw.types import Array
from sim.types import Space


def words(name: str) -> str:
    """The name of an outcome for people: `on_blade` -> on blade."""
    return name.replace("_", " ")


def values(space: Space, point: Array) -> str:
    """A point of a space in words: the plain name of every dimension with its value and unit."""
    return ", ".join(f"{d.plain_name} {quantity(v, d.unit)}" for d, v in zip(space.dimensions, point, strict=True))


def meanings(*spaces: Space) -> Table:
    """Name, plain name, range with its unit, and meaning of every dimension of the spaces."""
    dimensions = [d for space in spaces for d in space.dimensions]
    body = [(d.name, d.plain, f"{number(d.low)} to {number(d.high)} {d.unit}".rstrip(), d.meaning) for d in dimensions]
    return rows(("name", "plain name", "range", "meaning"), body)


RECORDED = "recorded"
"""Instead of hardware: trials that were recorded before."""


def where(hw: str, world: str) -> str:
    """Where the trials of a session or rollout happened, from its facts."""
    if is_simulated(hw):
        return f"SIMULATED world {world.rsplit('/', maxsplit=1)[-1]}" if world else "recorded trials"
    return f"REAL ROBOT {hw}"


def badge(hw: str, hardware: str) -> Text:
    """The badge on every screen that says which hardware moves."""
    rest = "no real robot moves" if is_simulated(hw) or hw == RECORDED else "keep clear of the arm"
    return Text.assemble(mark(hw), f" {hardware}: {rest}")


def mark(hw: str) -> Text:
    """Only the short badge, for narrow places."""
    if hw == RECORDED:
        return Text(" RECORDED ", "black on yellow")
    return Text(" SIMULATED ", "black on cyan") if is_simulated(hw) else Text(" REAL ROBOT ", "white on red")


def checks(found: Sequence[Readiness]) -> RenderableType:
    """The checklist before a session, one row per check."""
    table = _table()
    for check in found:
        table.add_row(Text("ok", "green") if check.ok else Text("FAILED", "bold red"), check.name, check.detail)
    return indent(table)


def waiting(what: str, since_s: float) -> Text:
    """The animated line of a running step, fitted to the screen."""
    dots = "⠋⠙⠹⠸⠼⠴⠦⠧⠇⠏"
    line = Text(f"{dots[int(8 * since_s) % len(dots)]} {what}  ", no_wrap=True, overflow="ellipsis")
    return line.append(f"{since_s:.0f} s", "bold")


def spent(stages: Mapping[str, float]) -> str:
    """`16 s: finding 3 s, planning 12 s`: the total, and the stages of at least a second."""
    named = ", ".join(f"{stage} {seconds:.0f} s" for stage, seconds in stages.items() if seconds >= 1.0)
    return f"{sum(stages.values()):.0f} s{': ' if named else ''}{named}"


def keys(explain: str, keys: Sequence[tuple[str, str]]) -> RenderableType:
    """The text at `?`: the question explained, then every key with its effect."""
    table = _table()
    for key, meaning in keys:
        table.add_row(Text(key, "bold"), meaning)
    return indent(Group(*([Text(explain)] if explain else []), table))


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
    """Indented by two columns."""
    return Padding(what, (0, 0, 0, 2), expand=False)
