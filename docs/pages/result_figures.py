"""The figures of the results page, from the sessions in docs/results/sessions.csv."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import results

from adaptsim_cli.screen.svg import Canvas, Scale
from pages import standalone
from pages.numbers import SESSIONS

PANELS = (
    ("pushing", "Pushing, 40 drawn worlds"),
    ("pendulum", "Pendulum, 40 drawn"),
    ("foods-drawn", "40 drawn foods"),
)
METHODS = {
    "adaptsim": "adaptsim (ours)",
    "adaptsim-iteration": "the paper's policy",
    "bo-prior": "bo-prior",
    "sysid-bayes": "sysid-bayes",
    "random": "random",
}
"""Method -> its name in the legend. UDR, which needs no trial, is a dashed line."""
LOWEST = 0.4
"""Lowest reward of the first figure; its caption says so."""

WIDE, GAP, LEFT, TOP, HEIGHT = 238, 48, 40, 34, 200
STYLE = """
.m0{stroke:#0a6ebd;stroke-width:2.4}.m1{stroke:#b34700}.m2{stroke:#2e7d55}.m3{stroke:#8a4fb0}.m4{stroke:#c09000}
.udr{stroke:#777;stroke-dasharray:5 4}.equal{stroke:#777;stroke-dasharray:5 4}.world{fill:#0a6ebd99}
"""


def reward_by_trials() -> str:
    """Mean reward of the final policy after so many trials, a line for each method, as SVG."""
    canvas = Canvas(
        _width(), TOP + HEIGHT + 100, "Mean reward over the number of trials, for each method in three sets"
    )
    for column, (part, title) in enumerate(PANELS):
        curves = {method: _by_trials(part, method) for method in METHODS}
        last = max(max(curve) for curve in curves.values())
        udr = float(np.mean(list(_by_world(part, "udr").values())))
        x, y = _scales(column, 0.0, float(last), LOWEST)
        _frame(canvas, title, x, y, "trials")
        canvas.line(x.start, y(udr), x.end, y(udr), "udr")
        for number, curve in enumerate(curves.values()):
            canvas.curve([(x(trials), y(reward)) for trials, reward in curve.items()], f"line m{number}")
    at = float(LEFT)
    for css, name in [*((f"line m{n}", name) for n, name in enumerate(METHODS.values())), ("udr", "UDR, no trial")]:
        canvas.line(at, TOP + HEIGHT + 66, at + 22, TOP + HEIGHT + 66, css)
        canvas.text(at + 28, TOP + HEIGHT + 70, name)
        at += 52 + 6.6 * len(name)
    return standalone(canvas, STYLE)


def reward_by_world() -> str:
    """The reward of `adaptsim` over that of UDR, a dot for each world, as SVG."""
    canvas = Canvas(_width(), TOP + HEIGHT + 56, "Reward of adaptsim over the reward of UDR, a dot for each world")
    for column, (part, title) in enumerate(PANELS):
        udr, adapted = _by_world(part, "udr"), _by_world(part, "adaptsim")
        x, y = _scales(column, 0.0, 1.0, 0.0)
        _frame(canvas, title, x, y, "reward of UDR")
        canvas.line(x(0.0), y(0.0), x(1.0), y(1.0), "equal")
        for world, reward in adapted.items():
            canvas.dot(x(udr[world]), y(reward), 3.5, "world", f"{world}: UDR {udr[world]:.2f}, adaptsim {reward:.2f}")
    return standalone(canvas, STYLE)


def _width() -> float:
    return LEFT + 3 * WIDE + 2 * GAP + 10


def _scales(column: int, first: float, last: float, low: float) -> tuple[Scale, Scale]:
    start = LEFT + column * (WIDE + GAP)
    return Scale(first, last, start, start + WIDE), Scale(low, 1.0, TOP + HEIGHT, TOP)


def _frame(canvas: Canvas, title: str, x: Scale, y: Scale, below: str) -> None:
    canvas.text(x.start, 18, title, "title")
    canvas.grid(x, y)
    canvas.text((x.start + x.end) / 2, y.start + 36, below, anchor="middle")


def _by_world(part: str, method: str) -> Mapping[str, float]:
    """world -> mean reward of its sessions."""
    rewards: dict[str, list[float]] = {}
    for one in results.read(SESSIONS):
        if (one.part, one.method) == (part, method):
            rewards.setdefault(one.world, []).append(one.reward)
    return {world: float(np.mean(values)) for world, values in rewards.items()}


def _by_trials(part: str, method: str) -> Mapping[int, float]:
    """trials -> mean reward over the worlds."""
    rewards: dict[int, list[float]] = {}
    for one in results.read(SESSIONS):
        if (one.part, one.method) == (part, method):
            for trials, reward in one.after:
                rewards.setdefault(trials, []).append(reward)
    return {trials: float(np.mean(values)) for trials, values in sorted(rewards.items())}
