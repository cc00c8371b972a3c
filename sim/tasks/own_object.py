"""An own object: a task with the ranges for one kind of object instead of the paper's.

    task = "scooping"
    name = "tofu"

    [ranges]
    mu = [0.30, 0.40]
    h = [1.8, 2.6]

Parameters missing from `[ranges]` keep the task's own range. The ranges become Omega. The margin around it has the
proportions of the task's own margin and ends where that ends, because the scene is not tested beyond.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from hw.bounded import Unreadable, read_table
from sim.errors import ObjectError
from sim.tasks.task import Task
from sim.types import Dimension, Space


@dataclass(frozen=True)
class OwnObject:
    """Ranges of some parameters of one task, in its units. Raises ObjectError if low is not below high."""

    task: str
    name: str  # its name for a person
    ranges: Mapping[str, tuple[float, float]]

    def __post_init__(self) -> None:
        for key, (low, high) in self.ranges.items():
            if not low < high:
                raise ObjectError(
                    f"the object {self.name}: {key} = [{low:g}, {high:g}] is not a range: the first number must be the "
                    "smaller one; for a known value, give a narrow range around it"
                )


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    task: str
    name: str = Field(min_length=1, max_length=40, pattern=r"^[A-Za-z0-9][A-Za-z0-9 _-]*$")
    ranges: dict[str, tuple[float, float]] = Field(min_length=1)


def load_object(path: Path) -> OwnObject:
    """The object that a TOML file describes. Raises ObjectError naming file and key."""
    try:
        raw = read_table(path, finite=False)  # the ranges are checked by key
    except FileNotFoundError as error:
        raise ObjectError(f"there is no object file {path}: check the path") from error
    except Unreadable as error:
        raise ObjectError(f"the object file {path} {error}") from error
    if isinstance(raw.get("ranges"), dict):
        raw["ranges"] = {key: tuple(v) if isinstance(v, list) else v for key, v in raw["ranges"].items()}
    try:
        file = _File.model_validate(raw)
    except ValidationError as error:
        raise ObjectError(f"{path}: {_message(error)}") from error
    try:
        return OwnObject(file.task, file.name, file.ranges)
    except ObjectError as error:
        raise ObjectError(f"{path}: {error}") from error


def with_ranges(task: Task, own: OwnObject) -> Task:
    """The task with the object's ranges (Omega and the margin around it) and the object's name.

    Raises ObjectError on a parameter that the task does not have, and on a range beyond the task's margin.
    """
    if own.task != task.name:
        raise ObjectError(
            f"the object {own.name} is for the task {own.task}, not for {task.name}: name another --task or --object"
        )
    for key in own.ranges:
        if key not in task.parameters.names:
            near = difflib.get_close_matches(key, task.parameters.names, n=1)
            hint = f", did you mean {near[0]}?" if near else ";"
            known = ", ".join(task.parameters.names)
            raise ObjectError(f"the object {own.name}: {task.name} has no parameter {key!r}{hint} There are: {known}")
    pairs = [_narrowed(d, m, own) for d, m in zip(task.parameters.dimensions, task.margin.dimensions, strict=True)]
    parameters, margin = (Space(tuple(column)) for column in zip(*pairs, strict=True))
    mirror = task.mirror if task.mirror is not None and task.mirror.keeps(margin) else None
    return replace(task, parameters=parameters, margin=margin, mirror=mirror, object_name=own.name)


def _narrowed(usual: Dimension, tried: Dimension, own: OwnObject) -> tuple[Dimension, Dimension]:
    """One parameter's (range, margin) for the object; `tried` is the task's own margin."""
    if usual.name not in own.ranges:
        return usual, tried
    low, high = own.ranges[usual.name]
    whole = usual.scale == "integer"
    if whole and not (float(low).is_integer() and float(high).is_integer()):
        raise ObjectError(f"the object {own.name}: {usual.name} = [{low:g}, {high:g}]: both must be whole numbers")
    if not tried.low <= low < high <= tried.high:
        unit = f" {usual.unit}" if usual.unit else ""
        raise ObjectError(
            f"the object {own.name}: {usual.label} = [{low:g}, {high:g}] lies outside the range that the scene of "
            f"{own.task} supports, {tried.low:g} to {tried.high:g}{unit}: check the unit, and narrow the range"
        )
    ours = replace(usual, low=low, high=high)
    if whole:
        return ours, tried
    reach = Space((usual,)).normalise(np.array([[tried.low], [tried.high]]))
    wide = np.clip(Space((ours,)).denormalise(reach)[:, 0], tried.low, tried.high)
    return ours, replace(ours, low=float(wide[0]), high=float(wide[1]))


def _message(error: ValidationError) -> str:
    first: Any = min(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return f"unknown key {key!r}; an object file has task, name and the table [ranges]"
    if first["type"] == "missing":
        return f"{key} is missing; an object file has task, name and the table [ranges] with [low, high] of parameters"
    return f"{key} = {first['input']!r}: {first['msg'][0].lower()}{first['msg'][1:]}"
