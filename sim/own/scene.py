"""The parts that the scenes of all simulators share: a file beside the task's file, paths to attributes, and the
simulator's name.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from hw.plugins import did_you_mean
from sim.errors import TaskError

_PART = re.compile(r"^(\w+)((?:\[\d+\])*)$")
_SIMULATORS = (
    ("run_mujoco", "mujoco"),
    ("mjcf", "mujoco"),
    ("run_gym", "gymnasium"),
    ("run_drake", "drake"),
    ("program", "program"),
    ("mujoco", "mujoco"),
    ("gymnasium", "gymnasium"),
    ("pydrake", "drake"),
)
"""A name in the code of a task's function -> the simulator that it runs."""


def physics_of(function: FunctionType) -> str:
    """The simulator that a function runs: the first of those that its code names; else "python"."""
    names = _names_in(function)
    things = [function.__globals__.get(name) for name in names]
    names |= {str(getattr(thing, "physics", "")) for thing in things}
    return next((physics for name, physics in _SIMULATORS if name in names or physics in names), "python")


def files_of_scenes(function: FunctionType) -> tuple[str, ...]:
    """The files of the scenes that a function's code names."""
    things = [function.__globals__.get(name) for name in _names_in(function)]
    files = [getattr(thing, "file", None) for thing in things if hasattr(thing, "physics")]
    return tuple(sorted(str(file) for file in files if isinstance(file, Path)))


def _names_in(function: FunctionType) -> set[str]:
    """The names in a function's code, in the functions inside it, and in those of its module that it calls."""
    names, codes = set[str](), [function.__code__]
    while codes:
        code = codes.pop()
        new = {*code.co_names} - names
        names |= new
        codes += [inner for inner in code.co_consts if isinstance(inner, CodeType)]
        called = [function.__globals__.get(name) for name in new]
        codes += [
            one.__code__ for one in called if isinstance(one, FunctionType) and one.__globals__ is function.__globals__
        ]
    return names


def beside_caller(name: str, depth: int = 2) -> Path:
    """The file `name`; a relative one lies beside the file that calls. Raises TaskError if there is none."""
    path = Path(name).expanduser()
    if not path.is_absolute():
        path = Path(sys._getframe(depth).f_globals.get("__file__", "x")).absolute().parent / path
    if not path.is_file():
        raise TaskError(f"there is no file {path}: a relative path is relative to the file of the task")
    return path


def require_paths(what: str, paths: Any) -> dict[str, str]:
    """`{"mu": "geom/table/friction[0]"}`. Raises TaskError."""
    if not isinstance(paths, Mapping) or not all(isinstance(n, str) and isinstance(p, str) for n, p in paths.items()):
        raise TaskError(f"{what} = {paths!r}: it must map names of parameters to paths of attributes")
    return dict(paths)


def indexed(part: str, where: str) -> tuple[str, tuple[int, ...]]:
    """`friction[0]` as name and indices. Raises TaskError."""
    match = _PART.match(part)
    if match is None:
        raise TaskError(f"{where}: {part!r} is not an attribute; write a name, or a name with an index as friction[0]")
    return match[1], tuple(int(i) for i in re.findall(r"\d+", match[2]))


def attributes(thing: Any) -> list[str]:
    """The public attributes of a thing that are not methods."""
    names = [name for name in dir(thing) if not name.startswith("_")]
    return [name for name in names if not callable(_got(thing, name))]


def set_attribute(thing: Any, part: str, value: Any, where: str) -> None:
    """Set `name` or `name[i]` of a thing. Raises TaskError naming what there is."""
    name, index = indexed(part, where)
    if not hasattr(thing, name):
        raise TaskError(missing(where, f"attribute {name!r}", attributes(thing)))
    try:
        if not index:
            setattr(thing, name, value)
            return
        holder = getattr(thing, name)
        for i in index[:-1]:
            holder = holder[i]
        holder[index[-1]] = value
    except (IndexError, TypeError, ValueError, AttributeError) as error:
        raise TaskError(f"{where} cannot be set to {value!r}: {error}") from error


def missing(where: str, what: str, names: Iterable[str]) -> str:
    """The message that something is not there."""
    listing = sorted(n for n in names if n)
    shown = ", ".join(listing[:40]) + (", ..." if len(listing) > 40 else "")
    name = what.split("'")[1] if "'" in what else what
    return f"{where}: there is no {what}; there is {shown or 'nothing'}{did_you_mean(name, listing)}"


def value_of(p: Any, name: str, where: str) -> Any:
    """The parameter `name` of `p`. Raises TaskError."""
    try:
        return getattr(p, name)
    except AttributeError as error:
        raise TaskError(f"{where}: {error}") from error


def _got(thing: Any, name: str) -> Any:
    try:
        return getattr(thing, name)
    except Exception:  # noqa: BLE001 - a property of a foreign object may raise anything
        return None
