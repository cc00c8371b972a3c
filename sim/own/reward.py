"""The user's reward, measure and outcomes as parts of a task. A reward may take one trial or a stack of trials."""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack
from sim.errors import TaskError
from sim.own.values import NamedStates, Values, by_name
from sim.tasks.files import user_code
from sim.types import Space


@dataclass(frozen=True, eq=False)
class EndOfTrial:
    """A `Task.end_state`: the last state, or the numbers that `measure` makes of a trajectory."""

    state: Space
    measure: Callable[..., Any] | None
    path: str
    names: tuple[str, ...]

    def __call__(self, track: ObjectTrack) -> Array:
        """(k,)"""
        if self.measure is None:
            return np.asarray(track.state[-1])
        numbers = measured(self.measure, self.path, track.t_s, track.state, self.state.names)
        if set(numbers) != set(self.names):
            raise TaskError(
                f"measure returns {', '.join(numbers)} for one trial and {', '.join(self.names)} for another"
            )
        return np.array([numbers[name] for name in self.names])


def measured(
    measure: Callable[..., Any], path: str, t_s: Array, state: Array, names: Sequence[str]
) -> dict[str, float]:
    """The numbers that `measure` makes of times (N,) and states (N, k). Raises TaskError."""
    with user_code(path, lambda failure: f"measure {failure}"):
        numbers = measure(np.array(t_s), NamedStates.named(np.array(state), names))
    if not isinstance(numbers, Mapping) or not numbers:
        raise TaskError(f"measure returns {numbers!r}: it must return named numbers, as {{'height': 0.3}}")
    for name, value in numbers.items():
        if not isinstance(name, str) or np.ndim(value) != 0 or not np.isfinite(float(value)):
            raise TaskError(f"measure returns {name!r} = {value!r}: each must be a finite number")
    return {name: float(value) for name, value in numbers.items()}


@dataclass(frozen=True, eq=False)
class Reward:
    """A `Task.reward_of_success`: below 0 counts as 0; above 1 is an error of the task, which a check finds."""

    function: Callable[..., Any]
    path: str
    names: tuple[str, ...]  # of the end
    context: Space
    takes: int  # arguments: none, the end, or end and context
    stacks: bool

    def __call__(self, end: Array, context: Array) -> Array:
        """(..., k), (..., c) -> (...)"""
        return np.clip(self.unclipped(end, context), 0.0, 1.0)

    def unclipped(self, end: Array, context: Array) -> Array:
        """The function's own return value, before it is checked. Raises TaskError."""
        end, context = np.asarray(end, dtype=np.float64), np.asarray(context, dtype=np.float64)
        shape = np.broadcast_shapes(end.shape[:-1], context.shape[:-1])
        ends = np.broadcast_to(end, (*shape, end.shape[-1]))
        contexts = np.broadcast_to(context, (*shape, context.shape[-1]))
        if self.stacks or not shape:
            return np.broadcast_to(self._number(self._called(ends, contexts), shape), shape)
        rewards = np.empty(shape)
        for index in itertools.product(*map(range, shape)):
            rewards[index] = self._number(self._called(ends[index], contexts[index]), ())
        return rewards

    def _called(self, end: Array, context: Array) -> Any:
        columns = np.moveaxis(end, -1, 0)
        numbers = {n: float(v) if end.ndim == 1 else v for n, v in zip(self.names, columns, strict=True)}
        values = (Values("end", numbers), Values("context", by_name(self.context, context)))
        with user_code(self.path, lambda failure: f"reward {failure}"):
            return self.function(*values[: self.takes])

    def _number(self, value: Any, shape: tuple[int, ...]) -> Array:
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise TaskError(f"reward returns {value!r}: it must be a number from 0 to 1") from error
        if array.size == 1:
            array = array.reshape(())
        if array.shape not in ((), shape):
            raise TaskError(f"reward returns an array of shape {array.shape}: it must be one number for each trial")
        return array


def reward_of(function: Any, path: str, names: tuple[str, ...], ends: Space | None, context: Space) -> Reward:
    """The reward, after trying whether it takes stacks of trials. Raises TaskError."""
    if not callable(function):
        raise TaskError(f"reward = {function!r}: it must be a function of the end of a trial, and of its context")
    if (takes := _required(function)) > 2:
        raise TaskError(f"reward takes {takes} arguments: it must take the end, or the end and the context")
    rng = np.random.default_rng(0)
    one = Reward(function, path, names, context, takes, stacks=False)
    end = rng.random((8, len(names))) if ends is None else ends.sample(rng, 8)
    contexts = context.sample(rng, 8)
    single = one.unclipped(end, contexts)
    if not np.isfinite(single).all():
        bad = int(np.argmin(np.isfinite(single)))
        values = dict(zip(names, end[bad].round(4).tolist(), strict=True))
        raise TaskError(f"reward returns {single[bad]:g} for the end {values}: it must be a number from 0 to 1")
    try:
        stacked = Reward(function, path, names, context, takes, stacks=True)
        both = stacked.unclipped(end.reshape(2, 4, -1), contexts.reshape(2, 4, -1))
    except TaskError:  # written for a single trial, as with `if` or `max`
        return one
    return stacked if np.allclose(both.reshape(-1), single) else one


@dataclass(frozen=True, eq=False)
class OutcomeInWords:
    """The first of the task's own words whose condition holds at the end of a trial."""

    conditions: Mapping[str, Any]  # word -> function of the end; None: always
    end: EndOfTrial

    def __call__(self, track: ObjectTrack) -> str:
        """One of the words."""
        values = Values("end", dict(zip(self.end.names, map(float, self.end(track)), strict=True)))
        with user_code(self.end.path, lambda failure: f"a condition in `outcomes` {failure}"):
            return next((word for word, holds in self.conditions.items() if holds is None or holds(values)), "other")


def conditions_of(declared: Any, path: str, names: tuple[str, ...], ends: Space | None) -> Mapping[str, Any] | None:
    """`outcomes={"in the bin": lambda end: end.z < 0.1, "beside it": None}`, after trying each condition on a few ends.
    Raises TaskError.
    """
    if declared is None:
        return None
    if (
        not isinstance(declared, Mapping)
        or not all(isinstance(word, str) and word and (h is None or callable(h)) for word, h in declared.items())
        or None in [*declared.values()][:-1]
    ):
        raise TaskError(
            f"outcomes = {declared!r}: it must map words to conditions on the end, the last one to None, as "
            "{'in the bin': lambda end: end.z < 0.1, 'beside it': None}"
        )
    rng = np.random.default_rng(0)
    tried = rng.random((8, len(names))) if ends is None else ends.sample(rng, 8)
    for word, holds in declared.items():
        if holds is None:
            continue
        if (takes := _required(holds)) != 1:
            raise TaskError(f"outcomes[{word!r}] takes {takes} arguments: it must take the end of a trial alone")
        for end in tried:
            with user_code(path, partial("{} {}".format, f"outcomes[{word!r}]")):
                bool(holds(Values("end", dict(zip(names, end.tolist(), strict=True)))))
    return declared


def _required(function: Callable[..., Any]) -> int:
    """The number of arguments without a default."""
    inputs = inspect.signature(function).parameters.values()
    return sum(one.default is inspect.Parameter.empty for one in inputs)
