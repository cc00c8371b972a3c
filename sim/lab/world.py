"""Worlds of the simulated lab: hidden parameters, unmodelled effects, sensing and faults, as TOML.

A world file has the keys `task`, `description` and `physics` (sim/lab/physics.py) and the tables `[params]` (every
parameter of the task, in its units), `[nuisance]`, `[unmodelled]`, `[sensing]`, `[mount]` and `[faults]`. Only `task`
and `[params]` are required; everything else has nominal defaults.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, cast, get_type_hints

import numpy as np
from pydantic import BaseModel, Field, ValidationError, create_model

from hw.bounded import Unreadable, parse_table, read_table
from hw.collision import Table
from hw.plugins import did_you_mean
from hw.records import HandWritten
from hw.types import Array, frozen_array
from sim.errors import NoHardware, OutOfRange, UnknownName, WorldError
from sim.lab.physics import Physics, require_possible
from sim.panda.tool import ToolCorrection
from sim.tasks import declared_worlds, files_of, task_names
from sim.tasks.task import Task
from sim.types import Dimension, Space

_Tilt = Annotated[float, Field(ge=-50, le=50)]


@dataclass(frozen=True)
class Sensing:
    """Deviations of the lab's camera, and of the arm's joint sensors, from perfect ones."""

    depth_noise_scale: Annotated[float, Field(ge=0, le=20)] = 1.0  # 1 = the Azure Kinect model
    extrinsic_error_mm: Annotated[float, Field(ge=0, le=100)] = 1.0
    extrinsic_error_deg: Annotated[float, Field(ge=0, le=10)] = 0.1
    frame_drop: Annotated[float, Field(ge=0, le=0.9)] = 0.0  # share of frames lost
    camera: Literal["kinect", "small"] = "kinect"  # small: a quarter of the resolution, for tests
    encoder_noise_mrad: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Error of every joint, new at every rest of a calibration, one standard deviation."""
    joint_offset_mrad: Annotated[float, Field(ge=0, le=50)] = 0.0
    """Error of every joint's zero, root mean square; constant for one lab."""
    clock_offset_ms: Annotated[float, Field(ge=-500, le=500)] = 0.0
    """Delay of the camera's time stamps on the arm's clock."""
    camera_moved_mm: Annotated[float, Field(ge=0, le=100)] = 0.0
    """How far somebody has moved the camera since its nominal calibration; the direction is drawn."""
    camera_moved_deg: Annotated[float, Field(ge=0, le=10)] = 0.0
    """How far the camera was turned then; the axis is drawn."""
    board_scale: Annotated[float, Field(ge=0.5, le=2)] = 1.0
    """Ratio of the printed size of the calibration board to its stated size."""

    def stamped(self, t_s: float) -> float:
        """A time of the arm's clock, converted to the camera's own clock."""
        return t_s + 1e-3 * self.clock_offset_ms


@dataclass(frozen=True)
class Mount:
    """Deviations of table and tool from their assumed poses; only a touch-off measures them."""

    table_height_mm: Annotated[float, Field(ge=-50, le=50)] = 0.0
    """Height of the table top over z = 0 of the arm's base frame, at the base."""
    table_rise_mrad: tuple[_Tilt, _Tilt] = (0.0, 0.0)  # along X and along Y
    tool_height_mm: Annotated[float, Field(ge=-30, le=30)] = 0.0  # of the tool along its own Z
    tool_roll_mrad: Annotated[float, Field(ge=-100, le=100)] = 0.0  # of the tool about its own X

    @property
    def true(self) -> ToolCorrection:
        """The true poses, which the arm does not know.

        World W of the plant is the frame of the table, its top at z = 0. The arm assumes that its base is W. In truth
        its base B stands so that the table has the world's height and tilt in B.
        """
        table = Table(1e-3 * self.table_height_mm, *(1e-3 * slope for slope in self.table_rise_mrad))
        return ToolCorrection(table, height_m=1e-3 * self.tool_height_mm, roll_rad=1e-3 * self.tool_roll_mrad)


@dataclass(frozen=True)
class Faults:
    """Faults by trial number (from 1)."""

    camera_timeout: tuple[int, ...] = ()
    arm_reflex: tuple[int, ...] = ()
    pedal_release: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class World:
    """One lab to adapt to, hidden from learning and tracking."""

    name: str
    task: str
    description: str
    parameters: Array  # (p,) true values, in units
    nuisance: Array  # (n,)
    unmodelled: Any  # an instance of the task's `unmodelled`
    sensing: Sensing
    faults: Faults
    mount: Mount = Mount()
    physics: Physics = "drake"

    def require_lab(self) -> None:
        """Raises NoHardware for a world with a foreign physics, which has no arm and no camera."""
        if self.physics != "drake":
            raise NoHardware(
                f'world {self.name} has physics = "{self.physics}": there trials run without arm and '
                "camera. `adaptsim run-iteration` and `adaptsim rollout` work there; for this, name another --world"
            )


def list_worlds(task: Task) -> tuple[str, ...]:
    """Names of the worlds that ship with `task` or that it declares, sorted."""
    return tuple(sorted({*task.worlds, *_worlds(task.name)}))


def _worlds(task: str) -> tuple[str, ...]:
    folder = files_of(task, "worlds")
    return tuple(sorted({*declared_worlds(task), *(file.stem for file in folder.glob("*.toml"))}))


def shipped_worlds(task: Task, physics: Physics = "drake") -> tuple[World, ...]:
    """The worlds that ship with `task` and have that physics, sorted by name."""
    worlds = (load_world(name, task) for name in list_worlds(task))
    return tuple(world for world in worlds if world.physics == physics)


def tasks_of_world(name_or_path: str) -> tuple[str, ...]:
    """The tasks of a world: the one named in its file, or all with a shipped world of that name.

    Empty if there is no such world, or its file cannot be read; `load_world` gives the reason.
    """
    if name_or_path.endswith(".toml") or "/" in name_or_path:
        try:
            named = read_table(Path(name_or_path).expanduser()).get("task")
        except (OSError, Unreadable):
            return ()
        return (named,) if isinstance(named, str) else ()
    return tuple(task for task in task_names() if name_or_path in _worlds(task))


def load_world(name_or_path: str, task: Task) -> World:
    """The shipped world of that name, or the file at that path (anything with a `/` or ending in `.toml`).

    Raises UnknownName if there is none, WorldError if the file is malformed or for another task.
    """
    if name_or_path.endswith(".toml") or "/" in name_or_path:
        path = Path(name_or_path).expanduser()
        if not path.is_file():
            raise UnknownName(f"there is no world file {path}: check the path")
        return _parse(path.read_bytes(), path.stem, str(path), task)
    if name_or_path in task.worlds:
        raw = {"task": task.name, **task.worlds[name_or_path]}
        return _world(raw, name_or_path, f"world {name_or_path} of {task.name}", task)
    names = list_worlds(task)
    if name_or_path not in names:
        tasks = tasks_of_world(name_or_path)
        whose = f", but for {' and '.join(tasks)} (--task {tasks[0]})" if tasks else ""
        others = [world for other in task_names() for world in _worlds(other)]
        near = "" if tasks else did_you_mean(name_or_path, names) or did_you_mean(name_or_path, set(others))
        raise UnknownName(
            f"no world {name_or_path!r} for {task.name}{whose}; there are {', '.join(names) or 'none'}; "
            f"a file of your own is named by its path, ending in .toml{near}"
        )
    name = f"{name_or_path}.toml"
    return _parse((files_of(task.name, "worlds") / name).read_bytes(), name_or_path, f"world {name_or_path}", task)


_Model = TypeVar("_Model", bound=BaseModel)
_Kind = TypeVar("_Kind")


class _File(HandWritten):
    task: str
    description: str = ""
    physics: Physics = "drake"  # "mujoco": without arm or camera, in a physics that training does not use
    params: dict[str, Any]
    nuisance: dict[str, Any] = Field(default_factory=dict)
    unmodelled: dict[str, Any] = Field(default_factory=dict)
    sensing: dict[str, Any] = Field(default_factory=dict)
    mount: dict[str, Any] = Field(default_factory=dict)
    faults: dict[str, Any] = Field(default_factory=dict)


def _parse(data: bytes, name: str, source: str, task: Task) -> World:
    try:
        raw = parse_table(data, is_toml=True, finite=False)  # numbers are checked by name
    except Unreadable as error:
        raise WorldError(f"{source} {error}") from error
    return _world(raw, name, source, task)


def _world(raw: Mapping[str, Any], name: str, source: str, task: Task) -> World:
    file = _check(_File, raw, source, "")
    if file.task != task.name:
        raise WorldError(f"{source} is a world of {file.task!r}, not of {task.name!r}; name a world of this task")
    unmodelled = _build(task.unmodelled, file.unmodelled, source, "unmodelled")
    try:
        require_possible(task, file.physics, unmodelled)
    except OutOfRange as error:
        raise WorldError(f"{source}: {error}") from error
    _no_devices(file, source)
    return World(
        name=name,
        task=task.name,
        description=file.description,
        parameters=_parameters(file.params, task, source),
        nuisance=_vector(file.nuisance, task.nuisance, source, "nuisance", required=False),
        unmodelled=unmodelled,
        sensing=_build(Sensing, file.sensing, source, "sensing"),
        faults=_faults(file.faults, source),
        mount=_build(Mount, file.mount, source, "mount"),
        physics=file.physics,
    )


def _no_devices(file: _File, source: str) -> None:
    """Reject settings of arm and camera in a physics without them."""
    tables = [name for name in ("sensing", "mount", "faults") if getattr(file, name)]
    if file.physics != "drake" and tables:
        raise WorldError(
            f'{source}: [{tables[0]}] describes arm and camera, but with physics = "{file.physics}" trials run '
            "without them; leave the table out"
        )


def _check(model: type[_Model], raw: Mapping[str, Any], source: str, table: str) -> _Model:
    try:
        return model.model_validate({key: _tuples(value) for key, value in raw.items()})
    except ValidationError as error:
        raise WorldError(f"{source}: {_message(error, table, tuple(model.model_fields))}") from error


def _tuples(value: Any) -> Any:
    """TOML arrays as tuples, for frozen values."""
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def _message(error: ValidationError, table: str, keys: tuple[str, ...]) -> str:
    first = min(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    where = f"[{table}]" if table else "the top level"
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        near = difflib.get_close_matches(key, keys, n=1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        return f"unknown key {key!r} in {where}{hint}; known are {', '.join(keys) or 'none'}"
    if first["type"] == "missing" and key not in keys:
        return f"{key!r} in {where} is missing: the list is too short"
    if first["type"] == "missing":
        return f"{where} has no key {key!r}; it needs {', '.join(keys)}"
    return f"{key!r} in {where} is {first['input']!r}: {first['msg'].lower()}"


def _parameters(raw: Mapping[str, Any], task: Task, source: str) -> Array:
    values = _vector(raw, task.parameters, source, "params", required=True)
    for dimension, value in zip(task.margin.dimensions, values, strict=True):
        if dimension.scale == "integer" and not dimension.low <= value <= dimension.high:
            kinds = f"{dimension.low:g} to {dimension.high:g}"
            raise WorldError(f"{source}: {dimension.name} = {value:g} in [params] is not a kind; choose {kinds}")
    return values


def _vector(raw: Mapping[str, Any], space: Space, source: str, table: str, *, required: bool) -> Array:
    """Values of `space` from a table. A missing one has its default; else, in an optional table, its middle."""
    types = tuple(
        (
            d.name,
            (
                int | str if d.words else int if d.scale == "integer" else float,
                _left_out(d, float(middle), required=required),
            ),
        )
        for d, middle in zip(space.dimensions, space.middle, strict=True)
    )
    model = _check(_model(table, types), raw, source, table)
    values = [_index(d, getattr(model, d.name), source, table) for d in space.dimensions]
    for dimension, value in zip(space.dimensions, values, strict=True):
        _possible(dimension, float(value), source, table)
    return frozen_array(values)


@cache  # it takes 10 ms to make, and a list of worlds needs it for each of them
def _model(table: str, types: tuple[tuple[str, tuple[Any, Any]], ...]) -> type[BaseModel]:
    """The model of a table with these keys: (type, default) of each."""
    named: dict[str, Any] = dict(types)
    return create_model(table, __base__=HandWritten, **named)


def _index(dimension: Dimension, value: Any, source: str, table: str) -> float:
    """A number; for a category, the index of its word."""
    if not isinstance(value, str):
        return float(value)
    if value not in dimension.words:
        near = did_you_mean(value, dimension.words)
        raise WorldError(
            f"{source}: {dimension.name} = {value!r} in [{table}]: it must be one of {', '.join(dimension.words)}{near}"
        )
    return float(dimension.words.index(value))


def _left_out(dimension: Dimension, middle: float, *, required: bool) -> Any:
    """The value of a quantity that a table does not state; `...` if the table has to state it."""
    if dimension.default is not None:
        return int(dimension.default) if dimension.scale == "integer" else dimension.default
    return ... if required else middle


_SAME_QUANTITY = {
    "m": {"cm": 1e-2, "mm": 1e-3},
    "cm": {"m": 1e2, "mm": 1e-1},
    "mm": {"m": 1e3, "cm": 1e1},
    "rad": {"degrees": np.pi / 180},
    "kg": {"g": 1e-3},
    "g": {"kg": 1e3},
    "Pa": {"kPa": 1e3, "MPa": 1e6},
}
"""The factor from another unit to the expected one."""


def _possible(dimension: Dimension, value: float, source: str, table: str) -> None:
    """Reject impossible values, and values that look like another unit. Values outside the range are allowed."""
    what = f"{source}: {dimension.label} = {value:g} in [{table}]"
    usual = f"its range is {dimension.low:g} to {dimension.high:g}" + (f" {dimension.unit}" if dimension.unit else "")
    low, high = dimension.low, dimension.high
    reach = 20.0 if dimension.scale == "log" else 4.0
    far = value > high * reach or value < (low / reach if low > 0 else low * reach)
    if far:
        for unit, factor in _SAME_QUANTITY.get(dimension.unit, {}).items():
            if low <= value * factor <= high:
                raise WorldError(f"{what} looks like {unit}, but the unit is {dimension.unit}; {usual}")
    if (low > 0 and value <= 0) or (low >= 0 and value < 0):
        raise WorldError(f"{what} is not physically possible: it must be {'positive' if low > 0 else '0 or more'}")


def _build(kind: type[_Kind], raw: Mapping[str, Any], source: str, table: str) -> _Kind:
    """A frozen dataclass from a table, every key checked against the field's annotation."""
    model = _check(_model_of(cast("Any", kind), table), raw, source, table)
    try:
        return kind(**dict(model))
    except (ValueError, OutOfRange) as error:
        raise WorldError(f"{source}: [{table}] {error}") from error


@cache
def _model_of(kind: Any, table: str) -> type[BaseModel]:
    """The model of a table with the fields of a dataclass."""
    hints = get_type_hints(kind, include_extras=True)
    types: dict[str, Any] = {}
    for field in fields(kind):
        default = field.default if field.default_factory is MISSING else field.default_factory()
        types[field.name] = (hints[field.name], ... if default is MISSING else default)
    return create_model(table, __base__=HandWritten, **types)


def _faults(raw: Mapping[str, Any], source: str) -> Faults:
    faults = _build(Faults, raw, source, "faults")
    for field in fields(Faults):
        early = [n for n in getattr(faults, field.name) if n < 1]
        if early:
            raise WorldError(f"{source}: {field.name!r} in [faults] names trial {early[0]}; trials are numbered from 1")
    return faults
