"""Scenes of MuJoCo by name, and one rollout of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hw import extras
from hw.types import Array
from sim.errors import ExtraMissing, TaskError
from sim.own.scene import attributes, beside_caller, indexed, missing, require_paths, set_attribute, value_of

_GLOBAL = ("option", "compiler", "stat")
"""Parts of a scene without a name: `option/gravity[2]`."""
_ALIAS = {"opt": "option"}


def mjcf(file: str, paths: Mapping[str, str]) -> MujocoScene:
    """A scene of MuJoCo, and where its parameters are: `{"mu": "geom/table/friction[0]"}`.

    A path is kind/name/attribute, with the names of MJCF; `option/gravity[2]` has no name. Calling the scene with `p`
    compiles a model of its own for each rollout, so that nothing is left in it for the next one. A relative file lies
    beside the file that calls. Raises TaskError for a wrong path, ExtraMissing without MuJoCo.
    """
    scene = MujocoScene(beside_caller(file), require_paths("mjcf: paths", paths))
    scene.check()
    return scene


@dataclass(frozen=True, eq=False)
class MujocoScene:
    """See `mjcf`."""

    file: Path
    paths: Mapping[str, str]
    physics: str = field(default="mujoco", init=False)

    def __call__(self, p: Any) -> Any:
        """A new `mujoco.MjModel` with the values of `p`."""
        spec = self._spec
        for name, path in self.paths.items():
            thing, attribute = self._attribute_at(spec, name, path)
            set_attribute(thing, attribute, value_of(p, name, self._where(name, path)), self._where(name, path))
        try:
            return spec.compile()
        except ValueError as error:
            raise TaskError(f"{self.file} does not compile with {p!r}: {error}") from error

    def check(self) -> None:
        """Raises TaskError for a scene that cannot be read, and for a path that does not exist."""
        spec = self._spec
        for name, path in self.paths.items():
            thing, attribute = self._attribute_at(spec, name, path)
            key, index = indexed(attribute, self._where(name, path))
            if not hasattr(thing, key):
                raise TaskError(missing(self._where(name, path), f"attribute {key!r}", attributes(thing)))
            size = np.size(getattr(thing, key))
            if index and index[-1] >= size:
                raise TaskError(f"{self._where(name, path)}: {key} has {size} numbers, so the last is [{size - 1}]")
            if not index and size > 1:
                raise TaskError(f"{self._where(name, path)}: {key} has {size} numbers: choose one, as {key}[0]")

    @cached_property
    def _spec(self) -> Any:
        try:
            return _mujoco().MjSpec.from_file(str(self.file))
        except ValueError as error:
            raise TaskError(f"{self.file} is not a scene of MuJoCo: {error}") from error

    def _attribute_at(self, spec: Any, name: str, path: str) -> tuple[Any, str]:
        where = self._where(name, path)
        kind, *rest = path.split("/")
        kind = _ALIAS.get(kind, kind)
        if kind in _GLOBAL and len(rest) == 1:
            return getattr(spec, kind), rest[0]
        if len(rest) != 2:
            raise TaskError(f"{where}: a path is kind/name/attribute, as geom/table/friction[0]")
        if not hasattr(spec, f"{kind}s") and kind not in ("body",):
            raise TaskError(missing(where, f"kind {kind!r}", _kinds(spec)))
        things = spec.bodies if kind == "body" else getattr(spec, f"{kind}s")
        thing = next((one for one in things if one.name == rest[0]), None)
        if thing is None:
            raise TaskError(missing(where, f"{kind} {rest[0]!r}", (one.name for one in things)))
        return thing, rest[1]

    def _where(self, name: str, path: str) -> str:
        return f"{self.file.name}: {name} = {path!r}"

    def __reduce__(self) -> Any:
        return MujocoScene, (self.file, dict(self.paths))


def run_mujoco(
    model: Any,
    duration: float,
    see: Callable[[Any], Any],
    control: Callable[[Any], None] | None = None,
    start: Callable[[Any], None] | None = None,
) -> tuple[Array, Array]:
    """One rollout: times (N,) from 0 to `duration` s and states (N, k), the values of `see(data)` at each step.

    `start(data)` sets the first positions and velocities, `control(data)` sets `data.ctrl` before each step. Positions
    and sensors are those of the present time.
    """
    mujoco = _mujoco()
    data = mujoco.MjData(model)
    if start is not None:
        start(data)
    steps = round(duration / model.opt.timestep)
    if steps < 1:
        raise TaskError(f"duration = {duration:g} s: it is shorter than a step of the scene, {model.opt.timestep:g} s")
    in_halves = model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4
    first, second = (mujoco.mj_step1, mujoco.mj_step2) if in_halves else (mujoco.mj_forward, mujoco.mj_step)
    warning = data.warning[mujoco.mjtWarning.mjWARN_BADQACC]  # looked up once: a step takes some 10 microseconds
    states = []
    for i in range(steps + 1):
        first(model, data)
        states.append(np.array(see(data), dtype=np.float64).reshape(-1))
        if control is not None:
            control(data)
        if i < steps:
            second(model, data)
        if warning.number:  # MuJoCo would begin again
            states[-1][:] = np.nan
            break
    return np.arange(len(states)) * model.opt.timestep, np.array(states)


def _kinds(spec: Any) -> list[str]:
    names = [name[:-1] for name in dir(spec) if name.endswith("s") and hasattr(spec, name[:-1])]
    return ["body", *_GLOBAL, *(name for name in names if not name.startswith("_"))]


def _mujoco() -> Any:
    try:
        import mujoco  # noqa: PLC0415 - an optional package
    except ModuleNotFoundError as error:
        raise ExtraMissing(extras.missing("a scene in MuJoCo", "mujoco", "mujoco")) from error
    return mujoco
