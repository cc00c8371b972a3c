"""Numbers, checks, tables and small pictures as people read them. Pure: only `console` touches the terminal."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.padding import Padding
from rich.style import Style
from rich.table import Table
from rich.text import Text

from adaptsim_cli.config import is_own, is_simulated
from adaptsim_cli.screen.row_table import RowTable
from hw.types import Array, JointPath

if TYPE_CHECKING:
    from sim.types import Dimension, Space


@dataclass(frozen=True)
class Readiness:
    """One line of the checklist before a session."""

    name: str
    ok: bool
    detail: str  # the finding, and the remedy if not ok


def failures(checks: Sequence[Readiness]) -> str:
    """The failing checks in one message."""
    return "; ".join(f"{check.name}: {check.detail}" for check in checks if not check.ok)


def typed(option: str, named: Mapping[str, float]) -> str:
    """Values as options to paste into a command: `--param mu=0.29 --param e=6.08e4`."""
    return " ".join(f"{option} {name}={number(value)}" for name, value in named.items())


def number(value: float) -> str:
    """Three significant digits, readable for people and commands: 0.29, 2140, 3.81e4."""
    if value == 0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"


NO_INTERVAL = "–"
"""Shown instead of an interval whose width is zero, or would be rounded to zero."""


def between(low: float, high: float, form: str = ".2f") -> str:
    """The two ends of an interval, `0.68 to 0.96`; `NO_INTERVAL` if both ends round to the same number."""
    ends = [f"{end:{form}}".replace("-", "−") for end in (low, high)]
    return NO_INTERVAL if ends[0] == ends[1] else " to ".join(ends)


def signed(value: float, digits: int = 2) -> str:
    """A number with its sign, −0.51 or +0.02; a rounded zero has none."""
    rounded = round(value, digits)
    return f"{rounded:+.{digits}f}".replace("-", "−") if rounded else f"{0.0:.{digits}f}"


def with_signs(text: str) -> str:
    """A sentence with a true minus before its numbers, and no sign before a zero."""
    return _ZERO.sub(r"\1", _NEGATIVE.sub("−", text))


_NEGATIVE, _ZERO = re.compile(r"(?<![\w.)-])-(?=\d)"), re.compile(r"[−+](0(?:\.0+)?)(?![\d.])")


def predicted_between(low: float, high: float) -> str:
    """The interval of a predicted reward: `0.68 to 0.96`; without a width, the reason why there is none."""
    interval = between(low, high)
    return interval if interval != NO_INTERVAL else f"{interval}: all simulators that may be true predict the same"


def quantity(value: float, unit: str) -> str:
    """A number with its unit for people; a length to the millimetre at least: −1.0 mm, 0.680 m."""
    factor, short = _scale(value, unit)
    shown = f"{factor * value:.{1 if short == 'mm' else 3}f}" if unit == "m" and value else number(factor * value)
    return with_signs(f"{shown} {short}".rstrip())


def span(low: float, high: float, unit: str) -> str:
    """A range with the unit of the values in it: `10 to 500 kPa`, `0 to 60 mm`."""
    factor, short = scale_within(low, high, unit)
    return with_signs(f"{number(factor * low)} to {number(factor * high)} {short}".rstrip())


def scale_within(low: float, high: float, unit: str) -> tuple[float, str]:
    """The factor and the unit in which people read the values between `low` and `high`."""
    return _scale(0.99 * max(low, high, key=abs), unit)  # an end itself may have the next larger unit


def _scale(value: float, unit: str) -> tuple[float, str]:
    if unit == "m" and 0 < abs(value) < 0.1:
        return 1e3, "mm"
    if unit == "Pa" and abs(value) >= 1e3:
        return (1e-6, "MPa") if abs(value) >= 1e6 else (1e-3, "kPa")
    return 1.0, unit


def words(name: str) -> str:
    """The name of an outcome for people: `on_blade` -> on blade."""
    return name.replace("_", " ")


def value_in_words(dimension: Dimension, value: float) -> str:
    """A value with its unit; the word of a category, the nearest one for a mean."""
    if kinds := dimension.kinds:
        return kinds[min(max(round(value), 0), len(kinds) - 1)]
    return quantity(value, dimension.unit)


def chances_in_words(kinds: Sequence[str], chances: Sequence[float]) -> str:
    """The probabilities of the words of a category, the most probable first: `ice 71 %, wood 29 %`. A certain word
    stands alone.
    """
    likely = sorted(zip(chances, kinds, strict=True), key=lambda pair: -pair[0])
    texts = [f"{kind} {100 * chance:.0f} %" for chance, kind in likely if chance >= LEAST_SHOWN]
    return likely[0][1] if likely[0][0] > 1.0 - LEAST_SHOWN else ", ".join(texts)


LEAST_SHOWN = 0.005
"""A smaller chance is shown as 0 %."""


def sampled_in_words(dimension: Dimension, values: Array) -> str:
    """The mean of samples (m,) with its unit; for a category, the share of each word."""
    if kinds := dimension.kinds:
        return chances_in_words(kinds, dimension.shares(values))
    return quantity(float(np.mean(values)), dimension.unit)


def sampled(space: Space, samples: Array) -> str:
    """Samples (m, n) of a space in words: the plain name of each quantity with its mean, or the share of each word."""
    columns = zip(space.dimensions, np.transpose(samples), strict=True)
    return ", ".join(f"{d.plain_name} {sampled_in_words(d, column)}" for d, column in columns)


def values(space: Space, point: Array) -> str:
    """A point of a space in words: the plain name of every dimension with its value and unit."""
    return ", ".join(f"{d.plain_name} {value_in_words(d, v)}" for d, v in zip(space.dimensions, point, strict=True))


def kinds(dimension: Dimension) -> str:
    """The range of a quantity in the unit that commands take, or the words of a category."""
    if dimension.kinds:
        return ", ".join(dimension.kinds[round(dimension.low) : round(dimension.high) + 1])
    return f"{number(dimension.low)} to {number(dimension.high)} {dimension.unit}".rstrip()


def place(path: Path) -> str:
    """The shortest path that can be typed here: relative in the current folder, else from the home folder."""
    for base, mark in ((Path.cwd(), ""), (Path.home(), "~/")):
        if path.is_relative_to(base) and path != base:
            return f"{mark}{path.relative_to(base)}"
    return str(path)


@dataclass(frozen=True)
class FileLine:
    """A line that says what a file or folder is, and its place. On a terminal the place is a short link, elsewhere the
    whole path.
    """

    what: str
    path: Path

    def __rich_console__(self, console: Console, _: ConsoleOptions) -> RenderResult:
        path = self.path.absolute()
        shown = place(path) if console.is_terminal else str(path)
        yield Text.assemble(f"{self.what}: ", (shown, Style(link=path.as_uri())))


RECORDED = "recorded"
"""Instead of hardware: trials that were recorded before."""


def where(hw: str, world: str) -> str:
    """Where the trials of a session or rollout happened, from its facts."""
    if is_simulated(hw):
        return f"SIMULATED world {world.rsplit('/', maxsplit=1)[-1]}" if world else "recorded trials"
    return "YOUR ROBOT" if is_own(hw) else f"REAL ROBOT {hw}"


def badge(hw: str, hardware: str) -> Text:
    """The badge on every screen that says which hardware moves."""
    rest = "no real robot moves" if is_simulated(hw) or hw == RECORDED else "keep clear of the arm"
    if is_own(hw):
        rest = "adaptsim checks none of its motion"
    return Text.assemble(mark(hw), f" {hardware}: {rest}")


def mark(hw: str) -> Text:
    """The short badge alone, for narrow places."""
    if hw == RECORDED:
        return Text(" RECORDED ", "black on yellow")
    if is_own(hw):
        return Text(" YOUR ROBOT ", "white on red")
    return Text(" SIMULATED ", "black on cyan") if is_simulated(hw) else Text(" REAL ROBOT ", "white on red")


def checks(readiness: Sequence[Readiness]) -> RenderableType:
    """The checklist before a session, one row per check."""
    table = _table()
    for check in readiness:
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


def rows(
    head: Sequence[str], body: Iterable[Sequence[str]], right: Sequence[int] = (), whole: Sequence[int] = ()
) -> RowTable:
    """A plain table: `right` names the columns with numbers, and `whole` those that are never broken within a line."""
    return RowTable(head, tuple(body), right, whole)


def _table() -> Table:
    return Table(box=None, show_header=False, pad_edge=False)


def indent(what: RenderableType) -> Padding:
    """Indented by two columns."""
    return Padding(what, (0, 0, 0, 2), expand=False)


_EVERY = 20  # samples of a path between two poses for a speed


def clear_to_move(real: bool, what: str, duration_s: float | None = None, speed_m_s: float | None = None) -> str:
    """The question before a motion. `what` continues after "then": "goes home", "scoops and goes back".

    It is asked before the first motion of a command, and again whenever somebody may have reached in. `speed_m_s` is
    the tool's top speed. Unknown values are left out.
    """
    who = "THE REAL ROBOT" if real else "The simulated robot"
    parts = [f"{duration_s:.0f} s in all" if duration_s is not None and duration_s >= 1.0 else ""]
    parts.append(f"the tool at up to {speed_m_s:.2f} m/s" if speed_m_s is not None else "")
    details = ", ".join(part for part in parts if part)
    return f"Is the work area clear, nobody within reach? {who} then {what}" + (f": {details}" if details else "")


def top_speed_m_s(paths: Sequence[JointPath], pose: Callable[[Array], Array]) -> float:
    """Largest speed of the origin of `pose` (joints (7,) -> (4, 4)) along the paths."""
    return max(_speed_m_s(path, pose) for path in paths)


def _speed_m_s(path: JointPath, pose: Callable[[Array], Array]) -> float:
    indices = np.unique(np.append(np.arange(0, len(path.t_s), _EVERY), len(path.t_s) - 1))
    p_m = np.array([pose(q)[:3, 3] for q in path.q_rad[indices]])
    return float((np.linalg.norm(np.diff(p_m, axis=0), axis=1) / np.diff(path.t_s[indices])).max())
