"""Draw the figure of the method's page: one action, one parameter, and a reality that no parameter describes.

The curves are computed with the program's own discrepancy, weights and caution.
"""

from __future__ import annotations

import numpy as np

from adaptsim_cli.screen.svg import Canvas, Scale
from hw.types import Array
from pages import standalone
from sim.adaptation.densities import systematic
from sim.adaptation.discrepancy import END, LEAST_END_STD, Discrepancy
from sim.adaptation.outcome_posterior import KEPT
from sim.adaptation.session_forecast import CAUTION

FRICTIONS = np.linspace(0.5, 1.5, 1024)
"""Candidate simulators: a push slides the object by action / friction."""
ACTIONS = np.linspace(0.0, 1.0, 201)
GOAL, WIDTH = 0.62, 0.5
"""The reward is 1 at the goal, and 0 farther away than the width."""
UNIT = 0.25
"""Standard deviation of the ends, the unit of the discrepancy."""
PANELS = (("Before any trial", 0), ("After one trial", 1), ("After three trials", 3))
STYLE = """
.band{fill:#0a6ebd33;stroke:none}.mean{stroke:#0a6ebd;stroke-width:2}
.truth{stroke:#777;stroke-dasharray:5 4}.simulator{stroke:#b34700}
.trial{fill:#2e7d55}.choice{stroke:#0a6ebd}.best{stroke:#b34700}
"""


def simulated(friction: Array | float, action: Array) -> Array:
    """The end of the object, by a simulator."""
    return np.asarray(action / friction)


def real(action: Array) -> Array:
    """The end of the object in reality: the harder it is pushed, the more it falls behind a simulator."""
    return np.asarray(1.25 * action - 0.55 * action**2)


def reward(end: Array) -> Array:
    """One minus the distance to the goal, as a share of the width."""
    return np.maximum(0.0, 1.0 - np.abs(end - GOAL) / WIDTH)


def belief(tried: Array) -> tuple[Array, Array]:
    """Actions that were tried (N,) -> rewards (A, KEPT) of the draws of reality, and the drawn frictions (KEPT,)."""
    scale = END.times(2.0)
    discrepancy = Discrepancy(scale, tried[:, None], np.full(len(tried), LEAST_END_STD**2))
    residuals = (real(tried)[:, None] - simulated(FRICTIONS[None], tried[:, None])) / UNIT
    log = discrepancy.evidence(residuals)
    weights = np.exp(log - log.max())
    drawn = systematic(weights / weights.sum(), KEPT)
    added = discrepancy.drawn(ACTIONS[:, None], residuals[:, drawn], seed=1)
    ends = simulated(FRICTIONS[drawn][None], ACTIONS[:, None]) + UNIT * added
    return reward(ends), FRICTIONS[drawn]


def sequence() -> list[Array]:
    """The actions tried before each panel: each trial takes the action that the first particle would take."""
    tried: list[float] = []
    for _ in range(max(n for _, n in PANELS)):
        earned, _ = belief(np.array(tried))
        tried.append(float(ACTIONS[np.argmax(cautious(earned))]))
    return [np.array(tried[:n]) for _, n in PANELS]


def cautious(earned: Array) -> Array:
    """(A,) the expected reward minus the caution of the first particle."""
    return np.asarray(earned.mean(axis=1) - CAUTION * earned.std(axis=1))


def method_figure() -> str:
    """The whole figure as SVG."""
    wide, gap, left, top, height = 238, 44, 40, 34, 200
    canvas = Canvas(
        left + 3 * wide + 2 * gap + 10, top + height + 132, "Expected reward over the action in three stages"
    )
    for column, ((title, _), tried) in enumerate(zip(PANELS, sequence(), strict=True)):
        start = left + column * (wide + gap)
        x, y = Scale(0.0, 1.0, start, start + wide), Scale(0.0, 1.05, top + height, top)
        panel(canvas, title, x, y, tried)
    legend(canvas, left, top + height + 58)
    return standalone(canvas, STYLE)


def panel(canvas: Canvas, title: str, x: Scale, y: Scale, tried: Array) -> None:
    """One stage: the belief, the true reward, and the choices that follow."""
    earned, frictions = belief(tried)
    mean, std = earned.mean(axis=1), earned.std(axis=1)
    canvas.text(x.start, 18, title, "title")
    canvas.grid(x, y)
    canvas.text((x.start + x.end) / 2, y.start + 36, "action", anchor="middle")
    upper, lower = np.minimum(mean + std, 1.0), np.maximum(mean - std, 0.0)
    outline = np.concatenate([upper, lower[::-1]])
    along = np.concatenate([ACTIONS, ACTIONS[::-1]])
    canvas.curve(list(zip(x.many(along), y.many(outline), strict=True)), "band")
    expected = reward(simulated(float(frictions.mean()), ACTIONS))
    for values, css in ((reward(real(ACTIONS)), "truth"), (expected, "simulator"), (mean, "mean")):
        canvas.curve(list(zip(x.many(ACTIONS), y.many(values), strict=True)), css)
    for action in tried:
        canvas.dot(x(action), y(float(reward(real(np.array(action))))), 4.5, "trial")
    for action, css in ((ACTIONS[np.argmax(expected)], "best"), (ACTIONS[np.argmax(cautious(earned))], "choice")):
        canvas.line(x(action), y.start, x(action), y.start + 9, css)


def legend(canvas: Canvas, left: float, top: float) -> None:
    """The meaning of each line."""
    entries = (
        ("truth", "true reward (unknown to the method)"),
        ("simulator", "reward by the mean simulator alone; its tick is the best action there"),
        (
            "mean",
            "expected reward of reality with one standard deviation; its tick is the next action of the first particle",
        ),
    )
    for row, (css, words) in enumerate(entries):
        canvas.line(left, top + 20 * row, left + 22, top + 20 * row, css)
        canvas.text(left + 30, top + 20 * row + 4, words)
    last = top + 20 * len(entries)
    canvas.dot(left + 11, last, 4.5, "trial")
    canvas.text(left + 30, last + 4, "a trial")
