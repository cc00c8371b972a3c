"""The quantities of a task at the terminal: their meanings, and points that a person types as name=value."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.views import kinds, rows, span
from hw.types import Array

if TYPE_CHECKING:
    from sim.tasks.task import Task
    from sim.types import Dimension, Space


def point(space: Space, words: Sequence[str], otherwise: Array, what: str) -> Array:
    """(n,) values in units, from `words` of the form name=value. Missing ones come from `otherwise` (n,).

    Raises UsageError for a wrong name, number or range, naming the right ones.
    """
    values = dict(zip(space.names, np.asarray(otherwise, dtype=float), strict=True))
    for text in words:
        name, sign, number = text.partition("=")
        if not sign or name not in values:
            near = difflib.get_close_matches(name, space.names, n=1)
            hint = f"did you mean {near[0]}? " if near and near[0] != name else ""
            raise UsageError(f"{what} {text!r}: {hint}write name=value, e.g. {_examples(space)}")
        dimension = space.dimensions[space.names.index(name)]
        try:
            values[name] = float(dimension.words.index(number) if number in dimension.words else number)
        except ValueError:
            raise UsageError(f"{what} {text!r}: {number!r} is not a number") from None
        if not dimension.low <= values[name] <= dimension.high:
            raise UsageError(
                f"{what} {dimension.label} = {values[name]:g} lies outside of [{dimension.low:g}, {dimension.high:g}]: "
                "choose a value within"
            )
    return np.array([values[name] for name in space.names])


def _examples(space: Space) -> str:
    return ", ".join(f"{d.name}={(d.low + d.high) / 2:.3g} ({_range(d)})" for d in space.dimensions)


def _range(dimension: Dimension) -> str:
    unit = f" {dimension.unit}" if dimension.unit else ""
    plain = f"{dimension.plain}, " if dimension.plain else ""
    return f"{plain}{dimension.low:g} to {dimension.high:g}{unit}"


def meanings(task: Task, *, with_symbols: bool) -> RenderableType:
    """The quantities of a task under three headings: name, range with its unit, and meaning.

    `with_symbols` adds the names that commands take, and the nuisance; ranges then have the units of commands.
    """
    groups = [
        ("Simulation parameters: unknown, the session estimates them", task.parameters),
        ("Context: known before a trial", task.context),
        ("Action: chosen for each trial", task.action),
    ]
    if with_symbols:
        groups.append(("Nuisance: differs from trial to trial", task.nuisance))
    head = ("", *(("symbol",) if with_symbols else ()), "range", "meaning")
    parts: list[RenderableType] = []
    for title, space in groups:
        if len(space):
            symbols = [(d.name,) if with_symbols else () for d in space.dimensions]
            body = [
                (d.plain_name, *symbol, kinds(d) if with_symbols or d.kinds else span(d.low, d.high, d.unit), d.meaning)
                for d, symbol in zip(space.dimensions, symbols, strict=True)
            ]
            parts += [Text(""), Text(title, style="bold"), rows(head, body)]
    return Group(*parts)
