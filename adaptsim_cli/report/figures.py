"""The figures of a report: session data -> inline SVG. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptsim_cli.report.svg import Canvas, Scale, plain
from adaptsim_cli.session.records import DimensionRecord, TrialRecord
from hw.types import Array


def rewards(trials: Sequence[TrialRecord], iterations: int, particles: int, per_particle: int) -> str:
    """Reward of every trial, grouped by iteration; a bar is what was expected, a line the mean of the iteration."""
    canvas = Canvas(760, 250, "Reward of every trial")
    left, right, top, bottom = 38.0, 752.0, 12.0, 212.0
    y = Scale(0.0, 1.0, bottom, top)
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        canvas.line(left, y(tick), right, y(tick), "grid")
        canvas.text(left - 6, y(tick) + 4, f"{tick:g}", anchor="end")
    band = (right - left) / iterations
    slots = particles * per_particle
    step = min(band / (slots + 1), 46.0)
    means = []
    for iteration in range(iterations):
        middle = left + band * (iteration + 0.5)
        if iteration:
            canvas.line(left + band * iteration, top, left + band * iteration, bottom, "band")
        canvas.text(
            middle, bottom + 18, f"iteration {iteration + 1}" if band > 80 else str(iteration + 1), anchor="middle"
        )
        here = [t for t in trials if t.iteration == iteration]
        if here:
            mean = y(float(np.mean([t.reward for t in here])))
            means.append((middle, mean))
            canvas.line(middle - band * 0.42, mean, middle + band * 0.42, mean, "mean")
        for trial in here:
            slot = trial.particle * per_particle + trial.trial
            x = middle + step * (slot - (slots - 1) / 2)
            low, high = y(trial.predicted_low), y(trial.predicted_high)
            canvas.rect(x - 7, high, 14, max(low - high, 1.5), f"expected c{trial.particle}", 3)
            canvas.line(
                x - 7, y(trial.predicted_reward), x + 7, y(trial.predicted_reward), f"mean-expected c{trial.particle}"
            )
            told = f"trial {trial.number}: {trial.outcome.value.replace('_', ' ')}, reward {trial.reward:.2f}"
            css = "dot" if trial.reward > 0 else "dot open"
            canvas.dot(x, y(trial.reward), 5, f"{css} c{trial.particle}", told)
    if len(means) > 1:
        canvas.curve(means, "mean-curve")
    return canvas.svg()


def parameter(dimension: DimensionRecord, paths: Sequence[Sequence[float]]) -> str:
    """One parameter: its mean for every particle against iterations, inside its range."""
    canvas = Canvas(360, 190, f"{dimension.name} over the iterations")
    left, right, top, bottom = 52.0, 350.0, 12.0, 158.0
    y = Scale(dimension.low, dimension.high, bottom - 8, top + 8, log=dimension.scale == "log")
    canvas.rect(left, y(dimension.high), right - left, y(dimension.low) - y(dimension.high), "range", 4)
    whole = dimension.scale == "integer"
    for tick in range(round(dimension.low), round(dimension.high) + 1) if whole else y.ticks(4):
        canvas.line(left, y(tick), right, y(tick), "grid")
        canvas.text(left - 6, y(tick) + 4, plain(tick), anchor="end")
    count = max(len(path) for path in paths)
    x = Scale(0.0, max(count - 1.0, 1.0), left + 16, right - 16)
    for index in range(count):
        last = index == count - 1 and count > 1
        canvas.text(x(index), bottom + 18, "next" if last else str(index + 1), anchor="middle")
    for particle, path in enumerate(paths):
        nudge = 2.0 * (particle - (len(paths) - 1) / 2)  # particles at the same value stay visible
        points = [(x(i), y(value) + nudge) for i, value in enumerate(path)]
        canvas.curve(points, f"curve c{particle}")
        for (px, py), value in zip(points, path, strict=True):
            canvas.dot(px, py, 4, f"dot c{particle}", f"particle {particle + 1}: {plain(value)} {dimension.unit}")
    return canvas.svg()


def table_view(trials: Sequence[TrialRecord], area: Sequence[DimensionRecord], newest: int) -> str:
    """Tracked paths seen from above, and the goals: X to the right, Y up. Older iterations are faint."""
    paths = [np.array(t.track.state)[:, :2] for t in trials]
    goals = [t.goal_m for t in trials if t.goal_m is not None]
    corners = np.array([[d.low, d.high] for d in area[:2]]).T if len(area) >= 2 and not goals else np.zeros((0, 2))
    points = np.concatenate([*paths, corners, np.array(goals).reshape(-1, 2)])
    low, high = points.min(axis=0) - 0.015, points.max(axis=0) + 0.015
    width = 760.0
    left, right, top = 48.0, 752.0, 12.0
    per_m = min((right - left) / (high[0] - low[0]), 340.0 / (high[1] - low[1]))
    right = left + per_m * (high[0] - low[0])
    bottom = top + per_m * (high[1] - low[1])
    canvas = Canvas(min(width, right + 8), bottom + 44, "Tracked paths on the table, seen from above")
    x, y = Scale(low[0], high[0], left, right), Scale(low[1], high[1], bottom, top)
    canvas.rect(left, top, right - left, bottom - top, "table", 6)
    canvas.grid(x, y)
    canvas.text(
        (left + right) / 2,
        bottom + 36,
        "x in metres, away from the robot; y upwards, to the robot's left",
        anchor="middle",
    )
    if len(corners):
        canvas.rect(x(corners[0, 0]), y(corners[1, 1]), *_size(x, y, corners), "area", 4)
        canvas.text(x(corners[0, 0]), y(corners[0, 1]) + 16, "where the object is placed")
    for trial, path in sorted(zip(trials, paths, strict=True), key=lambda pair: pair[0].number):
        css = f"c{trial.particle}" + ("" if trial.iteration == newest else " faint")
        told = f"trial {trial.number}: {trial.outcome.value.replace('_', ' ')}, reward {trial.reward:.2f}"
        pixels = [(x(px), y(py)) for px, py in path]
        if trial.goal_m is not None:
            gx, gy = x(trial.goal_m[0]), y(trial.goal_m[1])
            canvas.line(*pixels[-1], gx, gy, f"miss {css}")
            for rise in (-5.0, 5.0):
                canvas.curve([(gx - 5.0, gy - rise), (gx + 5.0, gy + rise)], f"track {css}", f"goal of {told}")
        canvas.curve(pixels, f"track {css}", told)
        canvas.dot(*pixels[0], 3, f"dot open {css}", told)
        canvas.dot(*pixels[-1], 4.5, f"dot {css}" if trial.reward > 0 else f"dot open {css}", told)
    return canvas.svg()


def curve_view(trials: Sequence[TrialRecord], label: str, column: int, newest: int) -> str:
    """One quantity of every track against time. Older iterations are faint; a dashed line is a trial that failed."""
    paths = [(np.array(t.track.t_s), np.array(t.track.state)[:, column]) for t in trials]
    canvas = Canvas(760, 240, f"{label} over time")
    left, right, top, bottom = 48.0, 752.0, 12.0, 196.0
    everything = np.concatenate([values for _, values in paths])
    pad = 0.05 * max(float(np.ptp(everything)), 1e-6)
    x = Scale(0.0, max(float(t_s[-1]) for t_s, _ in paths), left, right)
    y = Scale(float(everything.min()) - pad, float(everything.max()) + pad, bottom, top)
    canvas.grid(x, y)
    canvas.text((left + right) / 2, bottom + 36, "time in s", anchor="middle")
    for trial, (t_s, values) in zip(trials, paths, strict=True):
        css = f"track c{trial.particle}" + ("" if trial.iteration == newest else " faint")
        css += "" if trial.reward > 0 else " failed"
        told = f"trial {trial.number}: {trial.outcome.value.replace('_', ' ')}, reward {trial.reward:.2f}"
        canvas.curve([(x(t), y(v)) for t, v in zip(t_s, values, strict=True)], css, told)
    return canvas.svg()


def _size(x: Scale, y: Scale, corners: Array) -> tuple[float, float]:
    return x(corners[1, 0]) - x(corners[0, 0]), y(corners[0, 1]) - y(corners[1, 1])
