"""Whether the values of a task fit each other. Nothing is simulated; `sim.rollouts.soundness` does that."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hw.types import Array
from sim.errors import TaskError
from sim.tasks.task import Task
from sim.types import Space


def require_declared(task: Task) -> None:
    """Raises TaskError naming the first wrong field, its value and the right one."""
    for complaint in _complaints(task):
        raise TaskError(f"the task {task.name}: {complaint}")


def _complaints(task: Task) -> Iterator[str]:
    for name in ("parameters", "margin", "context", "action", "nuisance"):
        yield from _of_space(name, getattr(task, name))
    yield from _of_margin(task.parameters, task.margin)
    yield from _of_sizes(task)
    yield from _of_observation(task)
    yield from _of_settings(task)
    yield from _of_report(task)


def _of_space(what: str, space: Space) -> Iterator[str]:
    for d in space.dimensions:
        if not (np.isfinite([d.low, d.high]).all() and d.low < d.high):
            yield f"{what} has {d.name} from {d.low:g} to {d.high:g}: the first must be smaller, and both finite"
        if d.scale == "log" and d.low <= 0.0:
            yield f"{what} has {d.name} from {d.low:g} with the scale log: such a range begins above 0"
        if d.words and (d.scale != "integer" or d.high - d.low != len(d.words) - 1):
            yield f"{what} has {d.name} with the words {', '.join(d.words)}: it must be an integer, one for each word"
    twice = [name for name in space.names if space.names.count(name) > 1]
    if twice:
        yield f"{what} has the name {twice[0]} {space.names.count(twice[0])} times: each name must be unique"


def _of_margin(parameters: Space, margin: Space) -> Iterator[str]:
    if margin.names != parameters.names:
        yield f"margin has {', '.join(margin.names)}: it must have the parameters, {', '.join(parameters.names)}"
        return
    for inner, outer in zip(parameters.dimensions, margin.dimensions, strict=True):
        if not outer.low <= inner.low < inner.high <= outer.high:
            yield (
                f"margin has {inner.name} from {outer.low:g} to {outer.high:g}: it must contain the parameter's range, "
                f"{inner.low:g} to {inner.high:g}"
            )
        if inner.unit != outer.unit:
            yield f"margin has {inner.name} in {outer.unit!r}: its unit must be the parameter's, {inner.unit!r}"


def _of_sizes(task: Task) -> Iterator[str]:
    noise, reference = np.asarray(task.action_noise), np.asarray(task.reference_context)
    if noise.shape != (len(task.action),):
        yield f"action_noise has the shape {noise.shape}: it must have a number for each action, {_all(task.action)}"
    elif (noise < 0.0).any():
        yield f"action_noise = {noise.tolist()}: it must be 0 or more"
    if reference.shape != (len(task.context),):
        right = f"it must have a number for each of {_all(task.context)}"
        yield f"reference_context has the shape {reference.shape}: {right}"
    elif len(reference):
        unit = task.context.normalise(reference)
        if ((unit < -1.0) | (unit > 2.0)).any():
            name = task.context.names[int(np.abs(unit - 0.5).argmax())]
            d = task.context.dimensions[task.context.names.index(name)]
            value = float(reference[task.context.names.index(name)])
            yield f"reference_context has {d.label} = {value:g}: it must lie near its range, {d.low:g} to {d.high:g}"


def _of_observation(task: Task) -> Iterator[str]:
    o, k = task.observation, len(task.observation.columns)
    for name in ("low", "high", "noise_mean", "noise_std"):
        values = np.asarray(getattr(o, name))
        if values.shape != (k,):
            yield f"observation.{name} has {values.size} numbers: it must have {k}, one for each of its columns"
            return
    if not (o.low < o.high).all():
        yield f"observation.low = {o.low.tolist()} and high = {o.high.tolist()}: low must be smaller in each column"
    if (o.noise_std < 0.0).any():
        yield f"observation.noise_std = {o.noise_std.tolist()}: it must be 0 or more"
    times: Array = np.asarray(o.times_s)
    if not len(times) or times[0] < 0.0 or not (np.diff(times) > 0.0).all():
        yield f"observation.times_s = {times.tolist()}: the times must increase, from 0 or more"


def _of_settings(task: Task) -> Iterator[str]:
    a = task.adaptation
    for name, low, high in (("horizon", 1, np.inf), ("trials_per_iteration", 1, np.inf), ("end_moments", 1, np.inf)):
        if not low <= getattr(a, name) <= high:
            yield f"adaptation.{name} = {getattr(a, name):g}: it must be {low:g} or more"
    for name in ("threshold", "discount", "trial_std", "delta"):
        if not 0.0 <= getattr(a, name) <= 1.0:
            yield f"adaptation.{name} = {getattr(a, name):g}: it must lie in 0 to 1"


def _of_report(task: Task) -> Iterator[str]:
    report = task.report
    if report is None:
        return
    if strange := set(report.successes) - set(report.outcomes):
        yield f"report.successes has {', '.join(sorted(strange))}: each must be one of its outcomes"
    if strange_columns := set(report.computed) - set(report.columns):
        yield f"report.computed has {', '.join(sorted(strange_columns))}: each must be one of its columns"


def _all(space: Space) -> str:
    return ", ".join(space.names) or "nothing"
