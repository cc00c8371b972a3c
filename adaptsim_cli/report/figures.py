"""The figures of a report: session data -> inline SVG. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from adaptsim_cli.report.svg import Canvas, Scale, plain
from adaptsim_cli.session.records import DimensionRecord, TrialRecord
from sim.adaptation.posterior import Posterior

WIDE, NARROW = 760.0, 400.0
"""Widths of figures, in their own pixels; a page shows the one that fits."""

LEVELS = (0.05, 0.25, 0.75, 0.95)
"""Quantiles of a posterior: the ends of the pale and of the strong band."""


def rewards(
    trials: Sequence[TrialRecord], iterations: int, particles: int, per_particle: int, width: float = WIDE
) -> str:
    """Reward of every trial, grouped by iteration; a bar is the expected range, a line the mean of the iteration."""
    canvas = Canvas(width, 250, "Reward of every trial")
    left, right, top, bottom = 38.0, width - 8.0, 12.0, 212.0
    y = Scale(0.0, 1.0, bottom, top)
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        canvas.line(left, y(tick), right, y(tick), "grid")
        canvas.text(left - 6, y(tick) + 4, f"{tick:g}", anchor="end")
    band = (right - left) / iterations
    slots = particles * per_particle
    step = min(band / (slots + 1), 46.0)
    half = min(7.0, 0.4 * step)
    means = []
    for iteration in range(iterations):
        middle = left + band * (iteration + 0.5)
        if iteration:
            canvas.line(left + band * iteration, top, left + band * iteration, bottom, "band")
        canvas.text(
            middle, bottom + 18, f"iteration {iteration + 1}" if band > 80 else str(iteration + 1), anchor="middle"
        )
        here = [t for t in trials if t.iteration == iteration + 1]
        if here:
            mean = y(float(np.mean([t.reward for t in here])))
            means.append((middle, mean))
            canvas.line(middle - band * 0.42, mean, middle + band * 0.42, mean, "mean")
        for trial in here:
            slot = (trial.trial - 1) % (particles * per_particle)
            x = middle + step * (slot - (slots - 1) / 2)
            low, high = y(trial.predicted_low), y(trial.predicted_high)
            canvas.rect(x - half, high, 2 * half, max(low - high, 1.5), f"expected c{trial.particle - 1}", 3)
            mean = y(trial.predicted_reward)
            canvas.line(x - half, mean, x + half, mean, f"mean-expected c{trial.particle - 1}")
            told = f"trial {trial.trial}: {trial.outcome_words}, reward {trial.reward:.2f}"
            css = "dot" if trial.reward > 0 else "dot open"
            canvas.dot(x, y(trial.reward), min(5.0, half + 1.0), f"{css} c{trial.particle - 1}", told)
    if len(means) > 1:
        canvas.curve(means, "mean-curve")
    return canvas.svg()


def parameter(
    dimension: DimensionRecord,
    paths: Sequence[Sequence[float]],
    posteriors: Sequence[Posterior] = (),
    index: int = 0,
) -> str:
    """The mean of one parameter for every particle against iterations, within its range.

    Bands show the posterior by the trajectories known at that time; for an integer parameter, the size of a circle
    shows the probability of a value. `index` is the parameter's index in the posteriors.
    """
    canvas = Canvas(360, 190, f"{dimension.name} over the iterations")
    left, right, top, bottom = 52.0, 350.0, 12.0, 158.0
    low, high = _seen(dimension, posteriors, index)
    y = Scale(low, high, bottom - 8, top + 8, log=dimension.scale == "log")
    canvas.rect(left, y(dimension.high), right - left, y(dimension.low) - y(dimension.high), "range", 4)
    whole = dimension.scale == "integer"
    for tick in range(round(low), round(high) + 1) if whole else y.ticks(4):
        canvas.line(left, y(tick), right, y(tick), "grid")
        canvas.text(left - 6, y(tick) + 4, plain(tick), anchor="end")
    count = max(*(len(path) for path in paths), len(posteriors))
    x = Scale(0.0, max(count - 1.0, 1.0), left + 22, right - 22)
    for i, known in enumerate(posteriors):
        _belief(canvas, known, index, x(i), y, whole=whole)
    for i in range(count):
        last = i == count - 1 and count > 1
        canvas.text(x(i), bottom + 18, "next" if last else str(i + 1), anchor="middle")
    for particle, path in enumerate(paths):
        nudge = 2.0 * (particle - (len(paths) - 1) / 2)  # particles at the same value stay visible
        points = [(x(i), y(value) + nudge) for i, value in enumerate(path)]
        canvas.curve(points, f"curve c{particle}")
        for (px, py), value in zip(points, path, strict=True):
            canvas.dot(px, py, 4, f"dot c{particle}", f"particle {particle + 1}: {plain(value)} {dimension.unit}")
    return canvas.svg()


def _seen(dimension: DimensionRecord, posteriors: Sequence[Posterior], index: int) -> tuple[float, float]:
    """The range, extended to include the posterior's bands."""
    ends = [p.quantiles((LEVELS[0], LEVELS[-1]))[:, index] for p in posteriors]
    return (
        float(min([dimension.low, *(low for low, _ in ends)])),
        float(max([dimension.high, *(high for _, high in ends)])),
    )


def _belief(canvas: Canvas, known: Posterior, index: int, x: float, y: Scale, *, whole: bool) -> None:
    if whole:
        for value in np.unique(known.samples[:, index]):
            share = float(known.weights[known.samples[:, index] == value].sum())
            if share > 0.005 and y.low <= value <= y.high:
                canvas.dot(x, y(value), 16.0 * share**0.5, "likely", f"{plain(float(value))}: {100 * share:.0f} %")
        return
    low, lower, upper, high = (float(v) for v in known.quantiles(LEVELS)[:, index])
    told = f"90 % between {plain(float(f'{low:.3g}'))} and {plain(float(f'{high:.3g}'))}"
    for bottom, top in ((low, high), (lower, upper)):
        canvas.rect(x - 14, y(top), 28, max(y(bottom) - y(top), 2.0), "likely", 4, told)


@dataclass(frozen=True)
class Level:
    """One row of a comparison: a reward with its interval."""

    label: str
    short: str  # beside the label if there is little room
    detail: str  # below the label otherwise: the basis of the value
    mean: float
    low: float
    high: float
    colour: str  # "c0", "c1", ...
    is_open: bool = False  # an open dot on a dotted line


def levels(rows: Sequence[Level], width: float = WIDE) -> str:
    """Rewards with their intervals, one below the other, on one scale from 0 to 1."""
    canvas = Canvas(width, 34.0 + 44.0 * len(rows), "Rewards compared")
    wide = width > NARROW
    left, right, bottom = 300.0 if wide else 8.0, width - 46.0, 8.0 + 44.0 * len(rows)
    x = Scale(0.0, 1.0, left, right)
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        canvas.line(x(tick), 4.0, x(tick), bottom, "grid")
        canvas.text(x(tick), bottom + 18, f"{tick:g}", anchor="middle")
    for index, row in enumerate(rows):
        y, css = 8.0 + 44.0 * index + (22.0 if wide else 30.0), f"{'simulated ' if row.is_open else ''}{row.colour}"
        name = row.label if wide else f"{row.label}, {row.short}"
        canvas.text(0.0 if wide else left, y - (4.0 if wide else 14.0), name, "row")
        if wide:
            canvas.text(0.0, y + 11.0, row.detail)
        canvas.line(x(row.low), y, x(row.high), y, f"interval {css}")
        told = f"{row.label}: {row.mean:.2f}, {row.low:.2f} to {row.high:.2f}, {row.detail}"
        canvas.dot(x(row.mean), y, 5.5, f"dot {'open ' if row.is_open else ''}{css}", told)
        canvas.text(right + 10, y + 4, f"{row.mean:.2f}", "row")
    return canvas.svg()


@dataclass(frozen=True)
class Line:
    """One session of a comparison: its mean reward in each iteration."""

    label: str
    means: Sequence[float]
    intervals: Sequence[tuple[float, float]]
    colour: str


def lines(sessions: Sequence[Line], width: float = WIDE) -> str:
    """Mean reward against iterations, one line per session; a bar is the 95 % interval of a mean."""
    canvas = Canvas(width, 280, "Mean reward of every iteration")
    left, right, top, bottom = 38.0, width - 12.0, 12.0, 236.0
    y = Scale(0.0, 1.0, bottom, top)
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        canvas.line(left, y(tick), right, y(tick), "grid")
        canvas.text(left - 6, y(tick) + 4, f"{tick:g}", anchor="end")
    count = max(len(session.means) for session in sessions)
    x = Scale(0.0, max(count - 1.0, 1.0), left + 30, right - 30)
    for index in range(count):
        canvas.text(x(index), bottom + 18, str(index + 1), anchor="middle")
    canvas.text((left + right) / 2, bottom + 38, "iteration", anchor="middle")
    for place, session in enumerate(sessions):
        nudge = 5.0 * (place - (len(sessions) - 1) / 2) if len(sessions) < 9 else 0.0  # intervals stay apart
        points = [(x(i) + nudge, y(mean)) for i, mean in enumerate(session.means)]
        for (px, _), (low, high) in zip(points, session.intervals, strict=True):
            canvas.line(px, y(low), px, y(high), f"interval thin {session.colour}")
        canvas.curve(points, f"curve {session.colour}", session.label)
        for (px, py), mean in zip(points, session.means, strict=True):
            canvas.dot(px, py, 4.5, f"dot {session.colour}", f"{session.label}: {mean:.2f}")
    return canvas.svg()
