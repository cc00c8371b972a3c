"""The figures of paths: tracked ones, and observed against predicted ones. Session data -> inline SVG. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptsim_cli.report.figures import WIDE
from adaptsim_cli.report.hindsight import Prediction
from adaptsim_cli.report.svg import Canvas, Scale
from adaptsim_cli.session.records import DimensionRecord, TrialRecord
from hw.types import Array


def table_view(trials: Sequence[TrialRecord], area: Sequence[DimensionRecord], newest: int, width: float = WIDE) -> str:
    """Tracked paths seen from above, and the goals: X to the right, Y up. Older iterations are faint."""
    paths = [np.array(t.track.state)[:, :2] for t in trials]
    goals = [t.goal_m for t in trials if t.goal_m is not None]
    corners = np.array([[d.low, d.high] for d in area[:2]]).T if len(area) >= 2 and not goals else np.zeros((0, 2))
    points = np.concatenate([*paths, corners, np.array(goals).reshape(-1, 2)])
    low, high = points.min(axis=0) - 0.015, points.max(axis=0) + 0.015
    left, right, top = 48.0, width - 8.0, 12.0
    per_m = min((right - left) / (high[0] - low[0]), 340.0 / (high[1] - low[1]))
    right = left + per_m * (high[0] - low[0])
    bottom = top + per_m * (high[1] - low[1])
    canvas = Canvas(min(width, right + 8), bottom + 44, "Tracked paths on the table, seen from above")
    x, y = Scale(low[0], high[0], left, right), Scale(low[1], high[1], bottom, top)
    canvas.rect(left, top, right - left, bottom - top, "table", 6)
    canvas.grid(x, y)
    canvas.text((left + right) / 2, bottom + 36, "x in metres, away from the robot", anchor="middle")
    if len(corners):
        canvas.rect(x(corners[0, 0]), y(corners[1, 1]), *_size(x, y, corners), "area", 4)
        canvas.text(x(corners[0, 0]), y(corners[0, 1]) + 16, "where the object is placed")
    for trial, path in sorted(zip(trials, paths, strict=True), key=lambda pair: pair[0].trial):
        css = f"c{trial.particle - 1}" + ("" if trial.iteration == newest else " faint")
        told = f"trial {trial.trial}: {trial.outcome_words}, reward {trial.reward:.2f}"
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


def curve_view(trials: Sequence[TrialRecord], label: str, column: int, newest: int, width: float = WIDE) -> str:
    """One quantity of every track against time. Older iterations are faint; a dashed line is a trial that failed."""
    paths = [(np.array(t.track.t_s), np.array(t.track.state)[:, column]) for t in trials]
    canvas = Canvas(width, 240, f"{label} over time")
    left, right, top, bottom = 48.0, width - 8.0, 12.0, 196.0
    everything = np.concatenate([values for _, values in paths])
    pad = 0.05 * max(float(np.ptp(everything)), 1e-6)
    x = Scale(0.0, max(float(t_s[-1]) for t_s, _ in paths), left, right)
    y = Scale(float(everything.min()) - pad, float(everything.max()) + pad, bottom, top)
    canvas.grid(x, y)
    canvas.text((left + right) / 2, bottom + 36, "time in s", anchor="middle")
    for trial, (t_s, values) in zip(trials, paths, strict=True):
        css = f"track c{trial.particle - 1}" + ("" if trial.iteration == newest else " faint")
        css += "" if trial.reward > 0 else " failed"
        told = f"trial {trial.trial}: {trial.outcome_words}, reward {trial.reward:.2f}"
        canvas.curve([(x(t), y(v)) for t, v in zip(t_s, values, strict=True)], css, told)
    return canvas.svg()


def prediction(trial: TrialRecord, expected: Prediction, curves: Sequence[str] = ()) -> str:
    """The observed path of one trial against the predictions before it and in hindsight.

    On the table from above, or against time for quantities with names (`curves`), one panel each.
    """
    seen = np.array(trial.track.state)[:, list(expected.columns)]
    if not curves:
        return _from_above(trial, expected, seen)
    canvas = Canvas(400, 150 * len(curves) + 14, f"Trial {trial.trial}, observed and predicted")
    t_s = np.array(trial.track.t_s)
    x = Scale(0.0, float(max(t_s[-1], expected.t_s[-1])), 52.0, 392.0)
    for row, label in enumerate(curves):
        top = 150.0 * row + 16.0
        lines = [seen[:, row], expected.guess[:, row], *expected.likely[..., row]]
        low, high = _limits(np.concatenate(lines))
        y = Scale(low, high, top + 108.0, top)
        canvas.grid(x, y)
        canvas.text(52.0, top - 4, f"{label} over time in s")
        for path in expected.likely[..., row]:
            canvas.curve(_pixels(x, y, expected.t_s, path), "later")
        canvas.curve(_pixels(x, y, expected.t_s, expected.guess[:, row]), "before")
        canvas.curve(_pixels(x, y, t_s, seen[:, row]), f"track c{trial.particle - 1}", "observed")
    return canvas.svg()


def _from_above(trial: TrialRecord, expected: Prediction, seen: Array) -> str:
    """A view from above; both axes have the same scale, so a path keeps its shape."""
    everything = np.concatenate([seen, expected.guess, expected.likely.reshape(-1, seen.shape[1])])[:, :2]
    if trial.goal_m is not None:
        everything = np.concatenate([everything, np.array([trial.goal_m])])
    low, high = everything.min(axis=0), everything.max(axis=0)
    middle, size = (low + high) / 2, np.maximum(high - low, 0.02) + 0.01
    per_m = min(340.0 / size[0], 260.0 / size[1])
    half = np.array([170.0 / per_m, max(130.0, min(260.0, per_m * size[1])) / 2 / per_m])
    low, high = middle - half, middle + half
    bottom = 12.0 + per_m * float(high[1] - low[1])
    canvas = Canvas(400, bottom + 44, f"Trial {trial.trial}, observed and predicted path, seen from above")
    x, y = Scale(low[0], high[0], 52.0, 392.0), Scale(low[1], high[1], bottom, 12.0)
    canvas.rect(52.0, 12.0, 340.0, bottom - 12.0, "table", 6)
    canvas.grid(x, y)
    canvas.text(222.0, bottom + 36, "x in metres", anchor="middle")
    for path in expected.likely:
        canvas.curve(_pixels(x, y, path[:, 0], path[:, 1]), "later")
        canvas.dot(x(path[-1, 0]), y(path[-1, 1]), 2, "later-end")
    canvas.curve(_pixels(x, y, expected.guess[:, 0], expected.guess[:, 1]), "before")
    canvas.dot(x(expected.guess[-1, 0]), y(expected.guess[-1, 1]), 4, "before-end", "predicted end")
    canvas.curve(_pixels(x, y, seen[:, 0], seen[:, 1]), f"track c{trial.particle - 1}", "observed")
    css = "dot" if trial.reward > 0 else "dot open"
    canvas.dot(x(seen[-1, 0]), y(seen[-1, 1]), 4.5, f"{css} c{trial.particle - 1}", "observed end")
    if trial.goal_m is not None:
        gx, gy = x(trial.goal_m[0]), y(trial.goal_m[1])
        for rise in (-5.0, 5.0):
            canvas.curve([(gx - 5.0, gy - rise), (gx + 5.0, gy + rise)], f"track c{trial.particle - 1}", "goal")
    return canvas.svg()


def _pixels(x: Scale, y: Scale, across: Array, up: Array) -> list[tuple[float, float]]:
    return [(x(a), y(u)) for a, u in zip(across, up, strict=True)]


def _limits(values: Array) -> tuple[float, float]:
    pad = 0.05 * max(float(np.ptp(values)), 1e-6)
    return float(values.min()) - pad, float(values.max()) + pad


def _size(x: Scale, y: Scale, corners: Array) -> tuple[float, float]:
    return x(corners[1, 0]) - x(corners[0, 0]), y(corners[0, 1]) - y(corners[1, 1])


def one_path(track_m: Array, goal_m: Sequence[float] | None, width: float = WIDE) -> str:
    """One tracked path (N, 2 or more) seen from above, and its goal."""
    points = track_m[:, :2] if goal_m is None else np.concatenate([track_m[:, :2], np.array([goal_m])])
    low, high = points.min(axis=0) - 0.02, points.max(axis=0) + 0.02
    left, right, top = 52.0, width - 8.0, 12.0
    per_m = min((right - left) / (high[0] - low[0]), 320.0 / (high[1] - low[1]))
    right, bottom = left + per_m * (high[0] - low[0]), top + per_m * (high[1] - low[1])
    canvas = Canvas(width, bottom + 44, "Tracked path on the table, seen from above")
    x, y = Scale(low[0], high[0], left, right), Scale(low[1], high[1], bottom, top)
    canvas.rect(left, top, right - left, bottom - top, "table", 6)
    canvas.grid(x, y)
    canvas.text((left + right) / 2, bottom + 36, "x in metres, away from the robot", anchor="middle")
    pixels = _pixels(x, y, track_m[:, 0], track_m[:, 1])
    canvas.curve(pixels, "track c0", "the tracked centre")
    canvas.dot(*pixels[0], 3, "dot open c0", "start")
    canvas.dot(*pixels[-1], 4.5, "dot c0", "end")
    if goal_m is not None:
        gx, gy = x(goal_m[0]), y(goal_m[1])
        for rise in (-5.0, 5.0):
            canvas.curve([(gx - 5.0, gy - rise), (gx + 5.0, gy + rise)], "track c0", "goal")
    return canvas.svg()


def one_curve(t_s: Array, values: Array, label: str, width: float = WIDE) -> str:
    """One quantity (N,) of a track against time."""
    canvas = Canvas(width, 240, f"{label} over time")
    x, y = Scale(0.0, float(t_s[-1]), 48.0, width - 8.0), Scale(*_limits(values), 196.0, 12.0)
    canvas.grid(x, y)
    canvas.text((40.0 + width) / 2, 232.0, "time in s", anchor="middle")
    canvas.curve(_pixels(x, y, t_s, values), "track c0", label)
    return canvas.svg()
