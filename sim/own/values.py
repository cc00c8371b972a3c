"""The values that a user's function gets, by name; and a function of a file that can travel to another process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hw.plugins import did_you_mean
from hw.types import Array
from sim.tasks.task import TaskFile
from sim.types import Space


class Values:
    """Quantities by name: `p.mu`, or `p[name]` in a loop. Iterating gives (name, value) pairs."""

    def __init__(self, role: str, values: dict[str, Any]) -> None:
        self.__dict__.update(values)
        object.__setattr__(self, "_role", role)

    def __getattr__(self, name: str) -> Any:
        names = [key for key in self.__dict__ if not key.startswith("_")]
        role = self.__dict__.get("_role", "this value")
        raise AttributeError(
            f"{role} has no {name!r}: there is {', '.join(names) or 'nothing'}{did_you_mean(name, names)}"
        )

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{self._role}.{name} cannot be set: these values are given")

    def __repr__(self) -> str:
        return f"{self._role}({', '.join(f'{k}={v!r}' for k, v in self)})"

    def __iter__(self) -> Any:
        return iter([(key, value) for key, value in self.__dict__.items() if not key.startswith("_")])


def by_name(space: Space, values: Array) -> dict[str, Any]:
    """Values (..., n) of a space: name -> (...), a float for a single one; a category is its word."""
    array = np.asarray(values, dtype=np.float64)
    table = dict[str, Any]()
    for d, column in zip(space.dimensions, np.moveaxis(array, -1, 0), strict=True):
        if d.words:
            index = np.clip(np.rint(column), 0, len(d.words) - 1).astype(int)
            table[d.name] = d.words[int(index)] if array.ndim == 1 else np.array(d.words)[index]
        else:
            table[d.name] = float(column) if array.ndim == 1 else column
    return table


class NamedStates(np.ndarray):
    """States (N, k) as an array, whose columns also have names: `states.x` is (N,)."""

    _names: tuple[str, ...]

    @staticmethod
    def named(states: Array, names: Sequence[str]) -> NamedStates:
        """The same numbers, with names for the columns."""
        view = np.asarray(states, dtype=np.float64).view(NamedStates)
        view._names = tuple(names)
        return view

    def __getattr__(self, name: str) -> Any:
        names = self.__dict__.get("_names", ())
        if name in names:
            return np.asarray(self[..., names.index(name)])
        raise AttributeError(f"the states have no {name!r}: there is {', '.join(names)}{did_you_mean(name, names)}")


@dataclass(frozen=True, eq=False)
class Declared:
    """A function of a task in a file, which another process finds again in the same content of the file."""

    function: Callable[..., Any]
    file: TaskFile | None
    task: str
    field: str  # of the task

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """See the function."""
        return self.function(*arguments, **named)

    def __reduce__(self) -> Any:
        if self.file is None:
            return Declared, (self.function, None, self.task, self.field)
        return _again, (self.file, self.task, self.field)


def _again(file: TaskFile, task: str, field: str) -> Any:
    from sim.tasks.files import of_file  # noqa: PLC0415 - only another process needs it

    return getattr(of_file(file, task), field)
