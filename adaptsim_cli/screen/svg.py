"""A minimal plotting library for inline SVG that follows the page's light or dark theme.

Colours are CSS classes (`c0`, `c1`, ... for particles), so the same figure is readable on both backgrounds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np

from hw.types import Array


@dataclass(frozen=True)
class Scale:
    """A linear or logarithmic map from data to pixels."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, value: float) -> float:
        """Pixels of a value in units of the data."""
        low, high, value = (math.log(v) if self.log else v for v in (self.low, self.high, value))
        return self.start + (value - low) / (high - low) * (self.end - self.start)

    def many(self, values: Array) -> list[float]:
        """Pixels of many values (N,)."""
        low, high = (math.log(v) if self.log else v for v in (self.low, self.high))
        share = ((np.log(values) if self.log else np.asarray(values)) - low) / (high - low)
        return list(map(float, self.start + share * (self.end - self.start)))

    def ticks(self, most: int = 5) -> list[float]:
        """Round values inside the range."""
        if self.log:
            powers = range(math.ceil(math.log10(self.low) - 1e-9), math.floor(math.log10(self.high) + 1e-9) + 1)
            return [10.0**power for power in powers]
        rough = (self.high - self.low) / most
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(s * power for s in (1, 2, 2.5, 5, 10) if s * power >= rough * 0.999)
        first = math.ceil(self.low / step - 1e-9)
        return [k * step for k in range(first, math.floor(self.high / step + 1e-9) + 1)]


@dataclass
class Canvas:
    """Collects SVG elements."""

    width: float
    height: float
    label: str
    _parts: list[str] = field(default_factory=list)

    def line(self, x1: float, y1: float, x2: float, y2: float, css: str) -> None:
        """A straight line between two points, in pixels."""
        self._parts.append(f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" class="{css}"/>')

    def rect(
        self, x: float, y: float, width: float, height: float, css: str, radius: float = 0, title: str = ""
    ) -> None:
        """A rectangle from its top left corner, in pixels; `title` is shown when the pointer rests on it."""
        size = f'x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="{radius}" class="{css}"'
        self._parts.append(f"<rect {size}><title>{escape(title)}</title></rect>" if title else f"<rect {size}/>")

    def dot(self, x: float, y: float, radius: float, css: str, title: str = "") -> None:
        """A filled circle; `title` is shown when the pointer rests on it."""
        tip = f"<title>{escape(title)}</title>" if title else ""
        self._parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" class="{css}">{tip}</circle>')

    def curve(self, points: Sequence[tuple[float, float]], css: str, title: str = "") -> None:
        """A line through `points`, in pixels."""
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        tip = f"<title>{escape(title)}</title>" if title else ""
        self._parts.append(f'<polyline points="{path}" class="{css}">{tip}</polyline>')

    def text(self, x: float, y: float, text: str, css: str = "tick", anchor: str = "start") -> None:
        """A line of text, escaped; `anchor` is start, middle or end."""
        self._parts.append(f'<text x="{x:.1f}" y="{y:.1f}" class="{css}" text-anchor="{anchor}">{escape(text)}</text>')

    def grid(self, x: Scale, y: Scale) -> None:
        """Lines with their values, across the ranges of both scales; `y` starts at the bottom."""
        for tick in x.ticks(_most(x, 55.0, 7)):
            self.line(x(tick), y.end, x(tick), y.start, "grid")
            self.text(x(tick), y.start + 16, plain(round(tick, 4)), anchor="middle")
        for tick in y.ticks(_most(y, 24.0, 5)):
            self.line(x.start, y(tick), x.end, y(tick), "grid")
            self.text(x.start - 6, y(tick) + 4, plain(round(tick, 4)), anchor="end")

    def rewards(self, left: float, right: float, y: Scale) -> None:
        """Lines with their values for rewards, from 0 to 1."""
        for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
            self.line(left, y(tick), right, y(tick), "grid")
            self.text(left - 6, y(tick) + 4, f"{tick:g}", anchor="end")

    def svg(self) -> str:
        """The drawing as an SVG element with its label for screen readers."""
        return (
            f'<svg viewBox="0 0 {self.width:.0f} {self.height:.0f}" role="img" aria-label="{escape(self.label)}">'
            + "".join(self._parts)
            + "</svg>"
        )


def _most(scale: Scale, each: float, most: int) -> int:
    """The number of labels of `each` pixels that fit along a scale; at most `most`, at least 2."""
    return max(2, min(most, int(abs(scale.end - scale.start) / each)))


def plain(value: float) -> str:
    """A tick's label."""
    if value and (abs(value) >= 1e4 or abs(value) < 1e-3):
        exponent = math.floor(math.log10(abs(value)) + 1e-9)
        mantissa = value / 10**exponent
        digits = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"10{digits}" if abs(mantissa - 1) < 1e-6 else f"{mantissa:.3g} · 10{digits}"
    return f"{value:.4g}".replace("-", "−")
