"""The user's function as `Task.simulate`: it gets values by name and returns times and states."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from types import FunctionType
from typing import Any

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.errors import TaskError
from sim.own.values import Values, by_name
from sim.tasks.files import user_code
from sim.types import Space

ROLES = {"p": "p", "params": "p", "parameters": "p", "context": "context", "action": "action", "policy": "policy"}
"""Name of an argument of the user's function -> its role."""

MOST_TIMES = 200_000
"""Largest number of times of a rollout. No observation needs more, and hundreds of such rollouts fit into memory."""

_NO_TOOL = np.full(3, np.nan)


def roles_of(function: Callable[..., Any]) -> tuple[str, ...]:
    """The roles of the arguments of a task's function, in order. Raises TaskError."""
    inputs = inspect.signature(function).parameters
    needed = [name for name, one in inputs.items() if one.default is inspect.Parameter.empty]
    if named := [name for name in needed if inputs[name].kind is inspect.Parameter.KEYWORD_ONLY]:
        raise TaskError(
            f"the function {function.__name__} takes {', '.join(named)} only by keyword: leave out the * before it"
        )
    unknown = [name for name in needed if name not in ROLES]
    roles = tuple(ROLES[name] for name in needed if name in ROLES)
    if unknown or roles[:1] != ("p",) or len(set(roles)) < len(roles) or {"action", "policy"} <= set(roles):
        raise TaskError(
            f"the function {function.__name__} takes ({', '.join(needed)}): it must take (p, action), "
            "(p, context, action), (p, policy) or (p, context, policy), by these names"
        )
    return roles


def innermost(function: Callable[..., Any]) -> FunctionType:
    """The function that the user wrote, below all decorators. Raises TaskError if there is none with a name."""
    inner = inspect.unwrap(function)
    if not isinstance(inner, FunctionType) or not inner.__name__.isidentifier():
        raise TaskError(f"@adaptsim.task stands above {function!r}: it must stand above a function with a name")
    return inner


@dataclass(frozen=True, eq=False)
class Simulation:
    """A `Task.simulate` that calls a function with named values."""

    function: Callable[..., Any]
    roles: tuple[str, ...]
    path: str  # of the file
    parameters: Space
    context: Space
    action: Space
    nuisance: Space
    effects: type[Any]
    state: Space
    duration_s: float
    batched: bool

    def __call__(
        self, parameters: Array, context: Array, action: Any, nuisance: Array, unmodelled: Any = None
    ) -> ObjectTrack:
        """See `Simulate`. Raises TaskError naming the line and the values if the function fails."""
        if self.batched:
            p, c, a, n = (np.asarray(v, dtype=np.float64)[None] for v in (parameters, context, action, nuisance))
            return self.many(p, c, a, n, unmodelled)[0]
        times, states = self._called(parameters, context, action, nuisance, unmodelled)
        return self._track(*self._shaped(times, states))

    def many(
        self, parameters: Array, context: Array, action: Any, nuisance: Array, unmodelled: Any = None
    ) -> Sequence[ObjectTrack]:
        """See `SimulateMany`: one call of a batched function, whose states are (N, T, k)."""
        times, states = self._called(parameters, context, action, nuisance, unmodelled)
        stack = self._numbers("states", states)
        n, k = len(parameters), len(self.state)
        if k == 1 and stack.ndim == 2:
            stack = stack[..., None]
        if stack.ndim != 3 or stack.shape[0] != n or stack.shape[2] != k:
            raise self._wrong(
                f"returns states of shape {stack.shape}: a batched function of {n} rollouts returns ({n}, times, {k})"
            )
        return [self._track(*self._shaped(times, one)) for one in stack]

    def _called(self, parameters: Array, context: Array, action: Any, nuisance: Array, unmodelled: Any) -> Any:
        effects = asdict(self.effects() if unmodelled is None else unmodelled)
        p = by_name(self.parameters, parameters) | by_name(self.nuisance, nuisance) | effects
        chosen = Values("action", by_name(self.action, action)) if "action" in self.roles else action
        values = {
            "p": Values("p", p),
            "context": Values("context", by_name(self.context, context)),
            "action": chosen,
            "policy": chosen,
        }

        def sentence(failure: str) -> str:
            shown = " ".join(str(values[role]) for role in self.roles if role != "policy")
            return f"it {failure}, with {shown}"

        with user_code(self.path, sentence):
            result = self.function(*(values[role] for role in self.roles))
        if not isinstance(result, Sequence) or isinstance(result, str) or len(result) != 2:
            raise self._wrong(f"returns {_described(result)}: it must return two values, `times, states`")
        return result

    def _shaped(self, times: Any, states: Any) -> tuple[Array, Array]:
        """Times (N,) and states (N, k). Raises TaskError."""
        t_s = self._numbers("times", times)
        if isinstance(states, Mapping):
            missing = [name for name in self.state.names if name not in states]
            if missing:
                raise self._wrong(f"returns states without {', '.join(missing)}: it must have {_names(self.state)}")
            states = np.stack([self._numbers(name, states[name]) for name in self.state.names], axis=-1)
        rows = self._numbers("states", states)
        if rows.ndim == 1 and len(self.state) == 1:
            rows = rows[:, None]
        if t_s.ndim != 1 or len(t_s) == 0:
            raise self._wrong(f"returns times of shape {t_s.shape}: it must be a list of times in s")
        if len(t_s) > MOST_TIMES:
            raise self._wrong(
                f"returns {len(t_s):,} times: at most {MOST_TIMES:,} are kept; leave out rows, as states[::10]"
            )
        if rows.shape != (len(t_s), len(self.state)):
            raise self._wrong(
                f"returns states of shape {rows.shape} for {len(t_s)} times: the shape must be "
                f"({len(t_s)}, {len(self.state)}), a column each for {_names(self.state)}"
            )
        if not np.isfinite(t_s).all() or (np.diff(t_s) <= 0.0).any():
            back = int(np.argmax(~(np.diff(t_s) > 0.0)))
            raise self._wrong(f"returns times that do not increase after {t_s[back]:g} s: they must, in s")
        return t_s, rows

    def _track(self, t_s: Array, rows: Array) -> ObjectTrack:
        finite = np.isfinite(rows)
        if not finite.all():  # a solver that diverged: the trial failed, its numbers count for nothing
            row, column = np.argwhere(~finite)[0]
            name = self.state.names[column]
            flag = f"the state {name} is not a number at {t_s[row]:g} s"
            held = rows[row - 1] if row else np.where(finite[0], rows[0], self.state.middle)
            still = np.where(np.arange(len(t_s))[:, None] < row, rows, held)
            return ObjectTrack(t_s, still, Outcome.SOLVER_FAILED, _NO_TOOL, np.ones(len(t_s)), (flag,))
        return ObjectTrack(t_s, rows, Outcome.SETTLED, _NO_TOOL, np.ones(len(t_s)))

    def _numbers(self, what: str, value: Any) -> Array:
        if np.iscomplexobj(value):
            raise self._wrong(f"returns {what} that are complex numbers: take their real part, if that is meant")
        try:
            return np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise self._wrong(f"returns {what} that are not numbers of one shape: {error}") from error

    def _wrong(self, what: str) -> TaskError:
        function = inspect.unwrap(self.function)
        return TaskError(f"{self.path}, line {function.__code__.co_firstlineno}: {function.__name__} {what}")


def _described(value: Any) -> str:
    return f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else f"a {type(value).__name__}"


def _names(space: Space) -> str:
    return ", ".join(space.names)
