"""The figures of a report: session data -> inline SVG. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from adaptsim_cli.screen.outputs.learning import RevealedParameter
from adaptsim_cli.screen.svg import Canvas, Scale, plain
from adaptsim_cli.screen.views import LEAST_SHOWN, between
from adaptsim_cli.session.judgement import Prediction
from adaptsim_cli.session.records import DimensionRecord, TrialRecord
from adaptsim_cli.show.truth_view import positions
from hw.types import Array
from sim.adaptation.posterior import COLLAPSED, Posterior
from sim.adaptation.stages import Layout, Role

WIDE, NARROW = 760.0, 400.0
"""Widths of figures, in their own pixels; a page shows the one that fits."""

LEVELS = (0.05, 0.25, 0.75, 0.95)
"""Quantiles of a posterior: the ends of the pale and of the strong band."""


TICK = 10
"""Most letters of a word beside an axis."""

ROOM_PX = 26.0
"""Room for the number of an iteration below a figure."""


def _every(count: int, width: float) -> int:
    """The step between iterations whose number is shown, so that numbers have room."""
    return max(1, int(np.ceil(count * ROOM_PX / width)))


def rewards(
    trials: Sequence[TrialRecord], iterations: int, layout: Layout, width: float = WIDE, udr: float | None = None
) -> str:
    """Reward of every trial, grouped by iteration. A bar shows the predicted range, and a line the mean of the
    iteration.

    `udr` is the reward of UDR; None if it is not known.
    """
    canvas = Canvas(width, 250, "Reward of every trial")
    left, right, top, bottom = 38.0, width - 8.0, 12.0, 212.0
    y = Scale(0.0, 1.0, bottom, top)
    canvas.rewards(left, right, y)
    band = (right - left) / iterations
    slots = layout.particles * layout.trials
    step = min(band / (slots + 1), 46.0)
    half = min(7.0, 0.4 * step)
    means = []
    for iteration in range(iterations):
        middle = left + band * (iteration + 0.5)
        if iteration:
            canvas.line(left + band * iteration, top, left + band * iteration, bottom, "band")
        if iteration % _every(iterations, right - left) == 0:
            label = f"iteration {iteration + 1}" if band > 80 else str(iteration + 1)
            canvas.text(middle, bottom + 18, label, anchor="middle")
        here = [t for t in trials if t.iteration == iteration + 1]
        if here:
            mean = y(float(np.mean([t.reward for t in here])))
            means.append((middle, mean))
            canvas.line(middle - band * 0.42, mean, middle + band * 0.42, mean, "mean")
        places = zip(layout.numbers(iteration), layout.slots(iteration), strict=True)
        own = [number for number, slot in places if slot.role is not Role.CONTROL]
        for trial in here:
            slot = own.index(trial.trial)
            x = middle + step * (slot - (slots - 1) / 2)
            low, high = y(trial.predicted_low), y(trial.predicted_high)
            canvas.rect(x - half, high, 2 * half, max(low - high, 1.5), f"expected c{trial.particle - 1}", 3)
            mean = y(trial.predicted_reward)
            canvas.line(x - half, mean, x + half, mean, f"mean-expected c{trial.particle - 1}")
            css = "dot" if trial.is_rewarded else "dot open"
            canvas.dot(x, y(trial.reward), min(5.0, half + 1.0), f"{css} c{trial.particle - 1}", _told(trial))
    if len(means) > 1:
        canvas.curve(means, "mean-curve")
    if udr is not None:
        canvas.line(left, y(udr), right, y(udr), "udr")
        canvas.text(right, y(udr) - 5 if udr < 0.9 else y(udr) + 14, f"UDR {udr:.2f}", anchor="end")
    return canvas.svg()


def parameter(
    dimension: DimensionRecord,
    paths: Sequence[Sequence[float]],
    posteriors: Sequence[Posterior] = (),
    index: int = 0,
    kinds: Sequence[str] = (),
) -> str:
    """The mean of one parameter for every particle against iterations, within its range.

    Bands show the posterior from the trajectories until then. For an integer parameter, the size of a circle shows the
    probability of a value. `index` is the parameter's index in the posteriors. `kinds` are the words of a category.
    """

    def name(value: float) -> str:
        return kinds[round(value)] if kinds else f"{plain(value)} {dimension.unit}".rstrip()

    canvas = Canvas(360, 190, f"{dimension.name} over the iterations")
    left, right, top, bottom = 74.0 if kinds else 52.0, 350.0, 12.0, 158.0
    low, high = _seen(dimension, posteriors, index)
    y = Scale(low, high, bottom - 8, top + 8, log=dimension.scale == "log")
    canvas.rect(left, y(dimension.high), right - left, y(dimension.low) - y(dimension.high), "range", 4)
    whole = dimension.scale == "integer"
    for tick in range(round(low), round(high) + 1) if whole else y.ticks(4):
        canvas.line(left, y(tick), right, y(tick), "grid")
        canvas.text(left - 6, y(tick) + 4, name(tick)[:TICK] if kinds else plain(tick), anchor="end")
    count = max(*(len(path) for path in paths), len(posteriors))
    x = Scale(0.0, max(count - 1.0, 1.0), left + 22, right - 22)
    half = min(14.0, 0.45 * (right - left - 44.0) / max(count - 1, 1))  # neighbouring bands do not overlap
    for i, posterior in enumerate(posteriors):
        _belief(canvas, posterior, index, x(i), y, half, name if whole else None)
    every = _every(count, right - left)
    for i in range(count):
        last = i == count - 1 and count > 1
        if last or (i % every == 0 and (count < 3 or x(count - 1) - x(i) > ROOM_PX)):
            canvas.text(x(i), bottom + 18, "next" if last else str(i + 1), anchor="middle")
    for particle, path in enumerate(paths):
        nudge = 2.0 * (particle - (len(paths) - 1) / 2)  # particles at the same value stay visible
        points = [(x(i), y(value) + nudge) for i, value in enumerate(path)]
        canvas.curve(points, f"curve c{particle}")
        for (px, py), value in zip(points, path, strict=True):
            canvas.dot(px, py, 4, f"dot c{particle}", f"particle {particle + 1}: {name(value)}")
    return canvas.svg()


def _seen(dimension: DimensionRecord, posteriors: Sequence[Posterior], index: int) -> tuple[float, float]:
    """The range, extended to include the posterior's bands."""
    ends = [p.quantiles((LEVELS[0], LEVELS[-1]))[:, index] for p in posteriors if not p.is_collapsed]
    return (
        float(min([dimension.low, *(low for low, _ in ends)])),
        float(max([dimension.high, *(high for _, high in ends)])),
    )


def _belief(
    canvas: Canvas,
    posterior: Posterior,
    index: int,
    x: float,
    y: Scale,
    half: float,
    name: Callable[[float], str] | None,
) -> None:
    """`name` gives the word for a whole number of a category; None for other quantities."""
    if name is not None:
        for value in np.unique(posterior.samples[:, index]):
            share = float(posterior.weights[posterior.samples[:, index] == value].sum())
            if share > 0.005 and y.low <= value <= y.high:
                radius = min(16.0, 1.2 * half) * share**0.5
                canvas.dot(x, y(value), radius, "likely", f"{name(float(value))}: {100 * share:.0f} %")
        return
    if posterior.is_collapsed:
        at = min(max(float(posterior.mean[index]), y.low), y.high)
        canvas.dot(x, y(at), 7, "dot open", COLLAPSED)
        return
    low, lower, upper, high = (float(v) for v in posterior.quantiles(LEVELS)[:, index])
    tooltip = f"90 % between {plain(float(f'{low:.3g}'))} and {plain(float(f'{high:.3g}'))}"
    for bottom, top in ((low, high), (lower, upper)):
        canvas.rect(x - half, y(top), 2 * half, max(y(bottom) - y(top), 2.0), "likely", min(4.0, half), tooltip)


def truth(one: RevealedParameter) -> str:
    """A parameter's training range as a field, the belief of the session as a bar, and the truth as a dot."""
    canvas = Canvas(220, 22, f"{one.plain_name}: truth, range and belief")
    if one.kinds:
        _kinds(canvas, one)
        return canvas.svg()
    ends = [one.low, one.high, one.truth, *(one.believed or ())]
    at = [8.0 + x for x in positions(one, ends, 204)]
    canvas.rect(at[0], 4, at[1] - at[0], 14, "range", 3, "range of training")
    if one.believed is not None:
        canvas.rect(at[3], 7, max(at[5] - at[3], 2.0), 8, "likely", 3, "belief, 90 %")
    canvas.dot(at[2], 11, 4.5, "dot c2", "truth")
    return canvas.svg()


def _kinds(canvas: Canvas, one: RevealedParameter) -> None:
    """A place for each word of a category: a field if training had it, a circle whose size is its chance, and a dot at
    the truth.
    """
    room = 204.0 / len(one.kinds)
    for index, kind in enumerate(one.kinds):
        left = 8.0 + index * room
        if one.low <= index <= one.high:
            canvas.rect(left + 1, 4, room - 2, 14, "range", 3, kind)
        chance = 0.0 if one.chances is None else one.chances[index]
        if chance >= LEAST_SHOWN:
            canvas.dot(left + room / 2, 11, 9.0 * chance**0.5, "likely", f"{kind}: {100 * chance:.0f} %")
        if index == round(one.truth):
            canvas.dot(left + room / 2, 11, 4.5, "dot c2", f"truth: {kind}")


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
        tooltip = f"{row.label}: {row.mean:.2f}, {between(row.low, row.high)}, {row.detail}"
        canvas.dot(x(row.mean), y, 5.5, f"dot {'open ' if row.is_open else ''}{css}", tooltip)
        canvas.text(right + 10, y + 4, f"{row.mean:.2f}", "row")
    return canvas.svg()


def lines(sessions: Sequence[Sequence[Level]], width: float = WIDE) -> str:
    """Mean reward against iterations, one line per session; a bar is the 95 % interval of a mean."""
    canvas = Canvas(width, 280, "Mean reward of every iteration")
    left, right, top, bottom = 38.0, width - 12.0, 12.0, 236.0
    y = Scale(0.0, 1.0, bottom, top)
    canvas.rewards(left, right, y)
    count = max(map(len, sessions))
    x = Scale(0.0, max(count - 1.0, 1.0), left + 30, right - 30)
    for index in range(0, count, _every(count, right - left)):
        canvas.text(x(index), bottom + 18, str(index + 1), anchor="middle")
    canvas.text((left + right) / 2, bottom + 38, "iteration", anchor="middle")
    for place, session in enumerate(sessions):
        nudge = 5.0 * (place - (len(sessions) - 1) / 2) if len(sessions) < 9 else 0.0  # intervals stay apart
        points = [(x(i) + nudge, y(level.mean)) for i, level in enumerate(session)]
        for (px, _), level in zip(points, session, strict=True):
            canvas.line(px, y(level.low), px, y(level.high), f"interval thin {level.colour}")
        canvas.curve(points, f"curve {session[0].colour}", session[0].label)
        for (px, py), level in zip(points, session, strict=True):
            canvas.dot(px, py, 4.5, f"dot {level.colour}", f"{level.label}: {level.mean:.2f}")
    return canvas.svg()


def table_view(trials: Sequence[TrialRecord], area: Sequence[DimensionRecord], newest: int, width: float = WIDE) -> str:
    """Tracked paths seen from above, and the goals: X to the right, Y up. Older iterations are faint."""
    paths = [np.array(t.track.state)[:, :2] for t in trials]
    goals = [t.goal_m for t in trials if t.goal_m is not None]
    corners = np.array([[d.low, d.high] for d in area[:2]]).T if len(area) >= 2 and not goals else np.zeros((0, 2))
    points = np.concatenate([*paths, corners, np.array(goals).reshape(-1, 2)])
    canvas, x, y = _from_above(points, "Tracked paths on the table, seen from above", width)
    if len(corners):
        size = x(corners[1, 0]) - x(corners[0, 0]), y(corners[0, 1]) - y(corners[1, 1])
        canvas.rect(x(corners[0, 0]), y(corners[1, 1]), *size, "area", 4)
        canvas.text(x(corners[0, 0]), y(corners[0, 1]) + 16, "where the object is placed")
    for trial, path in sorted(zip(trials, paths, strict=True), key=lambda pair: pair[0].trial):
        css = f"c{trial.particle - 1}" + ("" if trial.iteration == newest else " faint")
        if trial.goal_m is not None:
            end = x(path[-1, 0]), y(path[-1, 1])
            canvas.line(*end, x(trial.goal_m[0]), y(trial.goal_m[1]), f"miss {css}")
        _path(canvas, x, y, path, trial.goal_m, css, _told(trial), is_rewarded=trial.is_rewarded)
    return canvas.svg()


def curve_view(trials: Sequence[TrialRecord], label: str, column: int, newest: int, width: float = WIDE) -> str:
    """One quantity of every track against time. Older iterations are faint; a dashed line is a trial that failed."""
    curves = []
    for trial in trials:
        css = f"c{trial.particle - 1}" + ("" if trial.iteration == newest else " faint")
        css += "" if trial.is_rewarded else " failed"
        curves.append((np.array(trial.track.t_s), np.array(trial.track.state)[:, column], css, _told(trial)))
    return _over_time(curves, label, width)


def prediction(trial: TrialRecord, expected: Prediction, curves: Sequence[str] = ()) -> str:
    """The observed path of one trial beside the predictions before it and in hindsight.

    It is drawn on the table from above. Quantities with names (`curves`) are drawn against time, one panel for each.
    """
    course, css = np.array(trial.track.state)[:, list(expected.columns)], f"c{trial.particle - 1}"
    if not curves:
        goal = np.array([] if trial.goal_m is None else [trial.goal_m]).reshape(-1, 2)
        likely = expected.likely.reshape(-1, course.shape[1])
        points = np.concatenate([*(states[:, :2] for states in (course, expected.guess, likely)), goal])
        label = f"Trial {trial.trial}, observed and predicted path, seen from above"
        canvas, x, y = _from_above(points, label, NARROW)
        for path in expected.likely:
            canvas.curve(_pixels(x, y, path[:, 0], path[:, 1]), "later")
            canvas.dot(x(path[-1, 0]), y(path[-1, 1]), 2, "later-end")
        canvas.curve(_pixels(x, y, expected.guess[:, 0], expected.guess[:, 1]), "before")
        canvas.dot(x(expected.guess[-1, 0]), y(expected.guess[-1, 1]), 4, "before-end", "predicted end")
        _path(canvas, x, y, course, trial.goal_m, css, "observed", is_rewarded=trial.is_rewarded)
        return canvas.svg()
    canvas = Canvas(400, 150 * len(curves) + 14, f"Trial {trial.trial}, observed and predicted")
    t_s = np.array(trial.track.t_s)
    x = Scale(0.0, float(max(t_s[-1], expected.t_s[-1])), 52.0, 392.0)
    for row, label in enumerate(curves):
        top = 150.0 * row + 16.0
        lines = [course[:, row], expected.guess[:, row], *expected.likely[..., row]]
        y = Scale(*_limits(np.concatenate(lines)), top + 108.0, top)
        canvas.grid(x, y)
        canvas.text(52.0, top - 4, f"{label} over time in s")
        for path in expected.likely[..., row]:
            canvas.curve(_pixels(x, y, expected.t_s, path), "later")
        canvas.curve(_pixels(x, y, expected.t_s, expected.guess[:, row]), "before")
        canvas.curve(_pixels(x, y, t_s, course[:, row]), f"track {css}", "observed")
    return canvas.svg()


def over_film(trial: TrialRecord, expected: Prediction) -> str:
    """The path predicted before the trial, drawn over its film; the height is the observed one. "" without a film."""
    if trial.film is None:
        return ""
    track = trial.track.track()
    z_m = np.interp(expected.t_s, track.t_s, track.state[:, 2])
    p_m = np.column_stack([expected.guess[:, :2], z_m, np.ones(len(z_m))])
    u, v, w = np.array(trial.film.camera).reshape(3, 4) @ p_m.T
    points = [(240.0 * x, 240.0 * y) for x, y in zip(u / w, v / w, strict=True)]
    canvas = Canvas(240, 240, "Predicted path")
    canvas.curve(points, "in-film")
    canvas.dot(*points[-1], 4, "in-film", "predicted end")
    return canvas.svg()


def _from_above(points_m: Array, label: str, width: float) -> tuple[Canvas, Scale, Scale]:
    """The table around points (N, 2); both axes have the same scale, so a path keeps its shape."""
    low, high = points_m.min(axis=0) - 0.015, points_m.max(axis=0) + 0.015
    left, top = 48.0, 12.0
    per_m = min((width - 8.0 - left) / (high[0] - low[0]), 340.0 / (high[1] - low[1]))
    middle, half = (low[1] + high[1]) / 2, max(high[1] - low[1], 130.0 / per_m) / 2  # room for the names of two ticks
    right, bottom = left + per_m * (high[0] - low[0]), top + per_m * 2 * half
    canvas = Canvas(min(width, right + 8), bottom + 44, label)
    x, y = Scale(low[0], high[0], left, right), Scale(middle - half, middle + half, bottom, top)
    canvas.rect(left, top, right - left, bottom - top, "table", 6)
    canvas.grid(x, y)
    canvas.text((left + right) / 2, bottom + 36, "x in metres, away from the robot", anchor="middle")
    return canvas, x, y


def _path(
    canvas: Canvas,
    x: Scale,
    y: Scale,
    path_m: Array,
    goal_m: Sequence[float] | None,
    css: str,
    label: str,
    *,
    is_rewarded: bool,
) -> None:
    """A path from its start to its end, and a cross at its goal."""
    pixels = _pixels(x, y, path_m[:, 0], path_m[:, 1])
    if goal_m is not None:
        gx, gy = x(goal_m[0]), y(goal_m[1])
        for rise in (-5.0, 5.0):
            canvas.curve([(gx - 5.0, gy - rise), (gx + 5.0, gy + rise)], f"track {css}", f"goal of {label}")
    canvas.curve(pixels, f"track {css}", label)
    canvas.dot(*pixels[0], 3, f"dot open {css}", label)
    canvas.dot(*pixels[-1], 4.5, f"dot {css}" if is_rewarded else f"dot open {css}", label)


def _over_time(curves: Sequence[tuple[Array, Array, str, str]], label: str, width: float) -> str:
    """Curves (times, values, style, title) against time."""
    canvas = Canvas(width, 240, f"{label} over time")
    x = Scale(0.0, max(float(t_s[-1]) for t_s, *_ in curves), 48.0, width - 8.0)
    y = Scale(*_limits(np.concatenate([values for _, values, *_ in curves])), 196.0, 12.0)
    canvas.grid(x, y)
    canvas.text((40.0 + width) / 2, 232.0, "time in s", anchor="middle")
    for t_s, values, css, tooltip in curves:
        canvas.curve(_pixels(x, y, t_s, values), f"track {css}", tooltip)
    return canvas.svg()


def _told(trial: TrialRecord) -> str:
    return f"trial {trial.trial}: {trial.outcome_words}, reward {trial.reward:.2f}"


def _pixels(x: Scale, y: Scale, across: Array, up: Array) -> list[tuple[float, float]]:
    return list(zip(x.many(across), y.many(up), strict=True))


def _limits(values: Array) -> tuple[float, float]:
    pad = 0.05 * max(float(np.ptp(values)), 1e-6)
    return float(values.min()) - pad, float(values.max()) + pad
