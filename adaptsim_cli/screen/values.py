"""Quantities typed by an operator as `name=value`, checked against their space."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli.errors import UsageError

if TYPE_CHECKING:
    from hw.types import Array
    from sim.types import Dimension, Space


def point(space: Space, given: Sequence[str], otherwise: Array, what: str) -> Array:
    """(n,) in units: `given` as name=value, missing ones from `otherwise` (n,).

    Raises UsageError for a wrong name, number or range, naming the right ones.
    """
    values = dict(zip(space.names, np.asarray(otherwise, dtype=float), strict=True))
    for text in given:
        name, sign, number = text.partition("=")
        if not sign or name not in values:
            near = difflib.get_close_matches(name, space.names, n=1)
            hint = f"did you mean {near[0]}? " if near and near[0] != name else ""
            raise UsageError(f"{what} {text!r}: {hint}write name=value, e.g. {_examples(space)}")
        try:
            values[name] = float(number)
        except ValueError:
            raise UsageError(f"{what} {text!r}: {number!r} is not a number") from None
        dimension = space.dimensions[space.names.index(name)]
        if not dimension.low <= values[name] <= dimension.high:
            raise UsageError(
                f"{what} {dimension.label} = {values[name]:g} lies outside of [{dimension.low:g}, {dimension.high:g}]: "
                "choose a value within"
            )
    return np.array([values[name] for name in space.names])


def typed(option: str, named: Mapping[str, float]) -> str:
    """Values as options to paste into a command: `--param mu=0.29 --param e=6.08e4`."""
    return " ".join(f"{option} {name}={number(value)}" for name, value in named.items())


def number(value: float) -> str:
    """Three significant digits, readable for people and commands: 0.29, 2140, 3.81e4."""
    if value == 0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"


def quantity(value: float, unit: str) -> str:
    """A number with its unit for people; a length under 1 cm in millimetres: −1.0 mm for −0.000976 m."""
    if unit == "m" and 0 < abs(value) < 0.01:
        return f"{1e3 * value:.1f} mm".replace("-0.0 ", "0.0 ")
    return f"{number(value)} {unit}".rstrip()


def _examples(space: Space) -> str:
    return ", ".join(f"{d.name}={(d.low + d.high) / 2:.3g} ({_range(d)})" for d in space.dimensions)


def _range(dimension: Dimension) -> str:
    unit = f" {dimension.unit}" if dimension.unit else ""
    plain = f"{dimension.plain}, " if dimension.plain else ""
    return f"{plain}{dimension.low:g} to {dimension.high:g}{unit}"
