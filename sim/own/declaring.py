"""The arguments of `adaptsim.task` as spaces. Each wrong one raises TaskError naming argument, value and remedy."""

from __future__ import annotations

import keyword
import math
import unicodedata
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np

from hw.plugins import did_you_mean
from sim.errors import TaskError
from sim.types import Dimension, Space

MARGIN = 0.25
"""How far a margin reaches beyond a range, as a fraction of it."""

_SCALES = ("log", "integer")
_RIGHT = '(low, high), (low, high, "unit"), (low, high, "unit", "log"), or a list of words for a category'


def space_of(what: str, declared: Any) -> Space:
    """`{"mu": (0.1, 0.3), "mass": (0.1, 2.0, "kg", "log"), "ground": ("ice", "wood")}` as a space."""
    if declared is None:
        return Space(())
    if not isinstance(declared, Mapping):
        raise TaskError(f"{what} = {declared!r}: it must map names to ranges, as {{'mu': (0.1, 0.3)}}")
    return Space(tuple(_dimension(f"{what}[{name!r}]", name, value) for name, value in declared.items()))


def _dimension(where: str, name: Any, value: Any) -> Dimension:
    require_name(where, name)
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise TaskError(f"{where} = {value!r}: it must be {_RIGHT}")
    if value and all(isinstance(word, str) for word in value):
        return _category(where, name, value)
    if len(value) < 2 or not all(_is_number(end) for end in value[:2]):
        raise TaskError(f"{where} = {value!r}: it must be {_RIGHT}")
    low, high, words = float(value[0]), float(value[1]), [*value[2:]]
    if len(words) > 2 or not all(isinstance(word, str) for word in words):
        raise TaskError(f"{where} = {value!r}: it must be {_RIGHT}")
    scale: Any = words.pop() if words and words[-1] in _SCALES else "linear"
    if len(words) > 1:
        raise TaskError(f"{where} = {value!r}: the scale {words[-1]!r} must be one of {', '.join(_SCALES)}")
    if not low < high:
        raise TaskError(f"{where} = {value!r}: the first number, {low:g}, must be smaller than the second, {high:g}")
    if scale == "log" and low <= 0.0:
        raise TaskError(f"{where} = {value!r}: a range with scale log begins above 0, not at {low:g}")
    if scale == "integer" and not (low.is_integer() and high.is_integer()):
        raise TaskError(f"{where} = {value!r}: the ends of an integer range must be whole numbers")
    return Dimension(name, words[0] if words else "", low, high, scale)


def _category(where: str, name: str, words: Sequence[str]) -> Dimension:
    if len(words) < 2 or len(set(words)) < len(words) or not all(words):
        raise TaskError(f"{where} = {words!r}: a category needs two or more different words")
    kinds = ", ".join(f"{index} {word}" for index, word in enumerate(words))
    return Dimension(name, "", 0.0, len(words) - 1.0, "integer", meaning=kinds, words=tuple(words))


def require_name(where: str, name: Any) -> None:
    """Raises TaskError unless a name can stand after a dot: `p.mu`."""
    if not isinstance(name, str) or not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_"):
        raise TaskError(f"{where}: the name {name!r} must be a word of letters, digits and _ that can follow a dot")
    if (plain := unicodedata.normalize("NFKC", name)) != name:
        raise TaskError(
            f"{where}: Python reads the letters of this name as others, {plain!a} for {name!a}: choose plain letters, "
            "as in mu"
        )


def require_apart(groups: Mapping[str, Sequence[str]]) -> None:
    """Raises TaskError if two groups have the same name, because all are attributes of `p`."""
    owner = dict[str, str]()
    for group, names in groups.items():
        for name in names:
            if name in owner:
                raise TaskError(
                    f"{group}[{name!r}]: {owner[name]} has this name too, and `p.{name}` must be one of them"
                )
            owner[name] = group


def margin_of(parameters: Space, declared: Any) -> Space:
    """The space that datasets cover: the ranges of `margin`, else each range and a quarter of it on both sides."""
    ends = {} if declared is None else declared
    if not isinstance(ends, Mapping):
        raise TaskError(f"margin = {declared!r}: it must map names of parameters to wider ranges (low, high)")
    require_known("margin", ends, parameters.names)
    return Space(tuple(_widened(d, ends.get(d.name)) for d in parameters.dimensions))


def _widened(inner: Dimension, ends: Any) -> Dimension:
    if ends is not None:
        outer = _dimension(f"margin[{inner.name!r}]", inner.name, ends)
        if not (outer.low <= inner.low and inner.high <= outer.high):
            raise TaskError(
                f"margin[{inner.name!r}] = ({outer.low:g}, {outer.high:g}): it must contain the parameter's range, "
                f"{inner.low:g} to {inner.high:g}"
            )
        return Dimension(inner.name, inner.unit, outer.low, outer.high, inner.scale, words=inner.words)
    if inner.scale == "integer":
        return inner
    low, high = Space((inner,)).denormalise(np.array([[-MARGIN], [1.0 + MARGIN]]))[:, 0]
    if inner.scale == "linear" and inner.low >= 0.0:
        low = max(low, inner.low / 2)  # a positive quantity stays positive
    elif inner.scale == "linear" and inner.high <= 0.0:
        high = min(high, inner.high / 2)
    return Dimension(inner.name, inner.unit, float(low), float(high), inner.scale)


def numbers_of(what: str, declared: Any, names: Sequence[str], *, low: float = 0.0) -> np.ndarray[Any, Any]:
    """`{"push": 0.02}` as an array in the order of `names`; names that are left out have 0."""
    table = {} if declared is None else declared
    if not isinstance(table, Mapping):
        raise TaskError(f"{what} = {declared!r}: it must map names to numbers, one or more of {', '.join(names)}")
    require_known(what, table, names)
    for name, value in table.items():
        if not _is_number(value) or value < low:
            raise TaskError(f"{what}[{name!r}] = {value!r}: it must be a number of {low:g} or more")
    return np.array([float(table.get(name, 0.0)) for name in names])


def require_known(what: str, names: Sequence[str] | Mapping[str, Any], right: Sequence[str]) -> None:
    """Raises TaskError for a name that is not one of the right ones."""
    for name in names:
        if name not in right:
            near = did_you_mean(str(name), right)
            names = ", ".join(right) or "nothing"
            raise TaskError(f"{what}[{name!r}]: there is no such name, it must be one of {names}{near}")


def number_of(what: str, value: Any, low: float, high: float = math.inf, *, whole: bool = False) -> float:
    """A number within its limits."""
    if not _is_number(value) or not low <= value <= high or (whole and float(value) != int(value)):
        kind = "a whole number" if whole else "a number"
        limit = f"from {low:g} to {high:g}" if math.isfinite(high) else f"of {low:g} or more"
        raise TaskError(f"{what} = {value!r}: it must be {kind} {limit}")
    return float(value)


def moments_of(duration: float, declared: Any) -> np.ndarray[Any, Any]:
    """The times of an observation: those declared, or their number, or eight; the last one is the end."""
    if declared is None:
        declared = 8
    if _is_number(declared):
        count = int(number_of("moments", declared, 1, 1000, whole=True))
        return duration * np.arange(1, count + 1) / count
    try:
        times_s = np.array([float(t) for t in declared])
    except (TypeError, ValueError) as error:
        raise TaskError(f"moments = {declared!r}: it must be a number of moments, or their times in s") from error
    if not len(times_s) or not np.isfinite(times_s).all() or (np.diff(times_s) <= 0).any():
        raise TaskError(f"moments = {declared!r}: the times must increase")
    if times_s[0] < 0.0 or times_s[-1] > duration * (1 + 1e-9):
        raise TaskError(f"moments = {declared!r}: the times must lie between 0 and the duration of {duration:g} s")
    return times_s


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
