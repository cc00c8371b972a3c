"""An own object: a task with the ranges, sizes and mass of one kind of object instead of the paper's.

    task = "scooping"
    name = "tofu"

    [ranges]
    mu = [0.30, 0.40]
    h = [1.8, 2.6]

    [sizes]
    radius = [0.010, 0.018]

Parameters missing from `[ranges]` keep the task's own range. The ranges become Omega. The margin around it has the
proportions of the task's own margin and ends where that ends, because the scene is not tested beyond. `[sizes]`
replaces ranges of the nuisance. `mass_kg` and `[effects]` change the scene itself, within the ranges from which worlds
are drawn.
"""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, ValidationError

from hw.bounded import Unreadable, read_table
from hw.records import HandWritten
from sim.errors import ObjectError
from sim.tasks import files_of, get_task
from sim.tasks.task import Task
from sim.types import Dimension, Space


@dataclass(frozen=True)
class OwnObject:
    """Ranges of some parameters of one task, in its units. Raises ObjectError if low is not below high."""

    task: str
    name: str  # its name for a person
    ranges: Mapping[str, tuple[float, float]]
    sizes: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # of the nuisance
    mass_kg: float | None = None  # of an object in the middle of its ranges; None: the task's
    effects: Mapping[str, Any] = field(default_factory=dict)  # of `Task.unmodelled`

    def __post_init__(self) -> None:
        for key, (low, high) in {**self.ranges, **self.sizes}.items():
            if not low < high:
                raise ObjectError(
                    f"the object {self.name}: {key} = [{low:g}, {high:g}] is not a range: the first number must be the "
                    "smaller one; for a known value, give a narrow range around it"
                )


class _File(HandWritten):
    task: str
    name: str = Field(min_length=1, max_length=40, pattern=r"^[A-Za-z0-9][A-Za-z0-9 _-]*$")
    ranges: dict[str, tuple[float, float]] = Field(default_factory=dict)  # parameter -> low and high, in task units
    sizes: dict[str, tuple[float, float]] = Field(default_factory=dict)  # the same for quantities of the nuisance
    mass_kg: float | None = Field(default=None, gt=0)  # what the object weighs; left out: the task's
    effects: dict[str, float | tuple[float, ...]] = Field(default_factory=dict)  # of the scene, as in a world's file


def object_file(task: str, named: str) -> Path:
    """The file of an object, by its path or by the name of a shipped one. Raises ObjectError on another name."""
    shipped = {file.parent.name: file for file in sorted(files_of(task, "checkpoints").glob("*/object.toml"))}
    if named not in shipped and not Path(named).suffix:
        names = ", ".join(shipped) or "none"
        raise ObjectError(f"there is no object {named}: give the path of a TOML file, or a shipped name ({names})")
    return shipped.get(named, Path(named))


def load_object(path: Path) -> OwnObject:
    """The object that a TOML file describes. Raises ObjectError naming file and key."""
    try:
        raw = read_table(path, finite=False)  # the ranges are checked by key
    except FileNotFoundError as error:
        raise ObjectError(f"there is no object file {path}: check the path") from error
    except Unreadable as error:
        raise ObjectError(f"the object file {path} {error}") from error
    for table in ("ranges", "sizes", "effects"):
        if isinstance(raw.get(table), dict):
            raw[table] = {key: tuple(v) if isinstance(v, list) else v for key, v in raw[table].items()}
    try:
        return OwnObject(**_File.model_validate(raw).model_dump())
    except ValidationError as error:
        raise ObjectError(f"{path}: {_message(error)}") from error
    except ObjectError as error:
        raise ObjectError(f"{path}: {error}") from error


def task_of_object(name: str, named: str = "") -> Task:
    """The task `name`, with the ranges of an object if one is named. Raises UnknownName, ObjectError."""
    task = get_task(name)
    return with_ranges(task, load_object(object_file(name, named))) if named else task


def as_toml(task: Task, own: OwnObject) -> str:
    """The file of an object, whole: with unit and meaning of every quantity."""
    lines = [f'task = "{own.task}"', f'name = "{own.name}"']
    lines += [] if own.mass_kg is None else [f"mass_kg = {own.mass_kg!r}"]
    for table, values, space in (("ranges", own.ranges, task.parameters), ("sizes", own.sizes, task.nuisance)):
        lines += ["", f"[{table}]"] if values else []
        for d in space.dimensions:
            if d.name in values:
                lines.append(f"{d.name} = {[*values[d.name]]}  # {d.unit + ', ' if d.unit else ''}{d.meaning}")
    lines += ["", "[effects]"] if own.effects else []
    lines += [f"{key} = {[*value] if isinstance(value, tuple) else value}" for key, value in own.effects.items()]
    return "\n".join(lines) + "\n"


def with_ranges(task: Task, own: OwnObject) -> Task:
    """The task with the object's ranges (Omega and the margin around it), sizes, scene and name.

    Raises ObjectError on a quantity that the task does not have, and on values beyond what its scene was tried with.
    """
    if own.task != task.name:
        raise ObjectError(
            f"the object {own.name} is for the task {own.task}, not for {task.name}: name another --task or --object"
        )
    _require_known(own, own.ranges, task.parameters.names, "parameter")
    _require_known(own, own.sizes, task.nuisance.names, "size")
    pairs = [_narrowed(d, m, own) for d, m in zip(task.parameters.dimensions, task.margin.dimensions, strict=True)]
    parameters, margin = (Space(tuple(column)) for column in zip(*pairs, strict=True))
    nuisance = Space(tuple(_sized(d, own) for d in task.nuisance.dimensions))
    mirror = task.mirror if task.mirror is not None and task.mirror.keeps(margin) else None
    changed = replace(task, parameters=parameters, margin=margin, nuisance=nuisance, mirror=mirror)
    effects = _effects(changed, own)
    if not effects:
        return replace(changed, object_name=own.name)
    if task.exact is not None:
        exact = f"{task.name} is solved exactly for its own scene"
        raise ObjectError(f"the object {own.name}: {exact}: leave mass and effects out")
    return _in_scene(replace(changed, object_name=own.name), task.unmodelled(**effects))


def _require_known(own: OwnObject, entries: Mapping[str, Any], names: Sequence[str], what: str) -> None:
    for key in [key for key in entries if key not in names]:
        near = difflib.get_close_matches(key, names, n=1)
        hint = f", did you mean {near[0]}?" if near else ";"
        listing = ", ".join(names) or "none"
        raise ObjectError(f"the object {own.name}: {own.task} has no {what} {key!r}{hint} There are: {listing}")


def _sized(usual: Dimension, own: OwnObject) -> Dimension:
    """A range of the nuisance for the object; its values are between half and twice those of the task."""
    low, high = own.sizes.get(usual.name, (usual.low, usual.high))
    reach = max(abs(usual.low), abs(usual.high))
    least, most = (usual.low / 2, usual.high * 2) if usual.low > 0.0 else (-2 * reach, 2 * reach)
    if not least <= low < high <= most:
        raise ObjectError(
            f"the object {own.name}: {usual.label} = [{low:g}, {high:g}] lies outside the range that the scene of "
            f"{own.task} supports, {least:g} to {most:g} {usual.unit}: check the unit"
        )
    return replace(usual, low=low, high=high)


def _effects(task: Task, own: OwnObject) -> dict[str, Any]:
    """The effects of the object's scene, its mass included. Raises ObjectError beyond those of worlds."""
    effects = dict(own.effects)
    _require_tried(task, own, effects)
    if own.mass_kg is not None:
        weighing = None if task.hardware is None else task.hardware.weighing
        if weighing is None:
            raise ObjectError(f"the object {own.name}: {task.name} has no mass to set: leave mass_kg out")
        effect, usual_kg = weighing
        parameters, nuisance = (s.middle for s in (task.parameters, task.nuisance))
        effects[effect] = own.mass_kg / usual_kg(parameters, nuisance, task.unmodelled(**effects))
    _require_tried(task, own, effects)
    return effects


def _require_tried(task: Task, own: OwnObject, effects: Mapping[str, Any]) -> None:
    _require_known(own, effects, tuple(task.plausible), "effect")
    for key, value in effects.items():
        low, high = task.plausible[key]
        if isinstance(low, str) or np.shape(value) != np.shape(low):
            raise ObjectError(f"the object {own.name}: the effect {key} takes no {value!r} here: leave it out")
        if not (np.all(np.less_equal(low, value)) and np.all(np.less_equal(value, high))):
            raise ObjectError(
                f"the object {own.name}: {key} = {value} lies outside the range that the scene of {own.task} was tried "
                f"in, {low} to {high}: check the unit"
            )


def _with_effects(function: Callable[..., Any], effects: Any, *arguments: Any, **named: Any) -> Any:
    """A function of a task that uses the object's effects if it is called without unmodelled effects."""
    bound = inspect.signature(function).bind(*arguments, **named)
    if bound.arguments.get("unmodelled") is None:
        bound.arguments["unmodelled"] = effects
    return function(*bound.args, **bound.kwargs)


def _in_scene(task: Task, effects: Any) -> Task:
    """The task with these effects wherever it is called without effects."""
    hardware = task.hardware
    if hardware is not None:
        names = [n for n in ("build_scene", "time_step_s", "rest_pose", "course") if getattr(hardware, n) is not None]
        changed: dict[str, Any] = {name: partial(_with_effects, getattr(hardware, name), effects) for name in names}
        hardware = replace(hardware, **changed)
    simulate = partial(_with_effects, task.simulate, effects)
    return replace(task, simulate=simulate, simulate_many=None, hardware=hardware, scene=effects)


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
        return (
            f"unknown key {key!r}; an object file has task, name, mass_kg and the tables [ranges], [sizes], [effects]"
        )
    if first["type"] == "missing":
        return f"{key} is missing; an object file has task, name and the table [ranges] with [low, high] of parameters"
    return f"{key} = {first['input']!r}: {first['msg'][0].lower()}{first['msg'][1:]}"
