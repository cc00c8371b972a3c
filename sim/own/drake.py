"""Scenes of Drake from a file, with parameters by the names in that file, and one rollout of them."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np

from hw.types import Array
from sim.errors import TaskError
from sim.own.scene import beside_caller, indexed, missing, require_paths, value_of

_NAMESPACES = {"drake": "http://drake.mit.edu"}


def drake(file: str, paths: Mapping[str, str], time_step: float = 1e-3) -> DrakeScene:
    """A scene of Drake (SDF, URDF or MJCF), and where its parameters are: `{"mass": "link/puck/inertial/mass"}`.

    A path begins with the kind and name of an element. It continues to an element with a number, or to an attribute
    whose numbers have indices: `joint/slide/axis/dynamics/damping`, `geom/table/friction[0]`. Calling the scene with
    `p` makes a plant of its own for each rollout. A relative file lies beside the file that calls. Raises TaskError.
    """
    scene = DrakeScene(beside_caller(file), require_paths("drake: paths", paths), time_step)
    scene.check()
    return scene


@dataclass(frozen=True, eq=False)
class DrakeModel:
    """A plant with its context, ready for one rollout."""

    plant: Any
    diagram: Any
    context: Any  # of the diagram

    @property
    def plant_context(self) -> Any:
        """The context of the plant."""
        return self.plant.GetMyMutableContextFromRoot(self.context)


@dataclass(frozen=True, eq=False)
class DrakeScene:
    """See `drake`."""

    file: Path
    paths: Mapping[str, str]
    time_step: float
    physics: str = field(default="drake", init=False)

    def __call__(self, p: Any) -> DrakeModel:
        """A new plant with the values of `p`."""
        from pydrake.multibody.parsing import Parser  # noqa: PLC0415 - slow to import
        from pydrake.multibody.plant import AddMultibodyPlantSceneGraph  # noqa: PLC0415
        from pydrake.systems.framework import DiagramBuilder  # noqa: PLC0415

        root = self._root()
        for name, path in self.paths.items():
            where = self._where(name, path)
            _setter_of(root, path, where)(value_of(p, name, where))
        text = Xml.tostring(root, encoding="unicode")
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, self.time_step)
        try:
            if re.search(r"<uri>|filename=|file=", text):  # other files, which lie beside this one
                with tempfile.NamedTemporaryFile("w", dir=self.file.parent, suffix=self.file.suffix) as beside:
                    beside.write(text)
                    beside.flush()
                    Parser(builder).AddModels(Path(beside.name))
            else:
                Parser(builder).AddModelsFromString(text, self.file.suffix.lstrip("."))
        except RuntimeError as error:
            raise TaskError(f"{self.file} cannot be parsed with {p!r}: {error}") from error
        plant.Finalize()
        diagram = builder.Build()
        return DrakeModel(plant, diagram, diagram.CreateDefaultContext())

    def check(self) -> None:
        """Raises TaskError for a path that does not exist."""
        root = self._root()
        for name, path in self.paths.items():
            _setter_of(root, path, self._where(name, path))

    def _root(self) -> Any:
        try:
            text = self.file.read_text(encoding="utf-8")
            for prefix, uri in _NAMESPACES.items():
                Xml.register_namespace(prefix, uri)
            return Xml.fromstring(text)
        except (OSError, UnicodeDecodeError, Xml.ParseError) as error:
            raise TaskError(f"{self.file} is not a scene of Drake: {error}") from error

    def _where(self, name: str, path: str) -> str:
        return f"{self.file.name}: {name} = {path!r}"


def run_drake(
    model: DrakeModel,
    duration: float,
    see: Callable[[Any, Any], Any],
    control: Callable[[Any, Any], Any] | None = None,
    start: Callable[[Any, Any], None] | None = None,
    every: float = 0.02,
) -> tuple[Array, Array]:
    """One rollout: times (N,) from 0 to `duration` s, each `every` s, and states (N, k), the values of `see`.

    `see`, `control` and `start` get the plant and its context. `start` sets the first state; `control` returns the
    actuation until the next time.
    """
    from pydrake.systems.analysis import Simulator  # noqa: PLC0415 - slow to import

    plant, inside = model.plant, model.plant_context
    if start is not None:
        start(plant, inside)
    simulator = Simulator(model.diagram, model.context)
    times = every * np.arange(round(duration / every) + 1, dtype=np.float64)
    states = list[Array]()
    for t_s in times:
        if control is not None:
            plant.get_actuation_input_port().FixValue(inside, np.atleast_1d(control(plant, inside)))
        try:
            simulator.AdvanceTo(t_s)
        except RuntimeError:  # the solver of contacts did not converge
            states += [np.full_like(states[-1], np.nan)] * (len(times) - len(states))
            break
        states.append(np.array(see(plant, inside), dtype=np.float64).reshape(-1))
    return times, np.array(states)


def _setter_of(root: Any, path: str, where: str) -> Callable[[float], None]:
    """How to write the number at a path. Raises TaskError."""
    parts = path.split("/")
    if len(parts) < 3:
        raise TaskError(f"{where}: a path is kind/name/element, as link/puck/inertial/mass")
    kind, name, *inner, last = parts
    things = [*root.iter(_tag(kind))]
    element = next((one for one in things if one.get("name") == name), None)
    if element is None:
        names = [one.get("name", "") for one in things] or sorted({_plain_tag(one) for one in root.iter()})
        raise TaskError(missing(where, f"{kind} {name!r}", names))
    for part in inner:
        child = element.find(_tag(part))
        if child is None:
            raise TaskError(missing(where, f"element {part!r}", [*map(_plain_tag, element)]))
        element = child
    key, index = indexed(last.removeprefix("@").replace(":", "__"), where)
    key = key.replace("__", ":")
    child = element.find(_tag(key))
    if child is None and key not in element.attrib:
        raise TaskError(missing(where, f"element or attribute {key!r}", [*map(_plain_tag, element), *element.attrib]))
    if child is not None and not (child.text or "").strip() and "value" in child.attrib:
        element, key, child = child, "value", None  # as Drake writes its own elements
    text = element.get(key, "") if child is None else child.text or ""
    numbers, at = text.split(), index[0] if index else 0
    if at >= len(numbers) or (not index and len(numbers) > 1):
        raise TaskError(f"{where}: {key} has {len(numbers)} numbers; choose one of them, as {key}[0]")

    def write(value: float) -> None:
        numbers[at] = repr(float(value))
        if child is None:
            element.set(key, " ".join(numbers))
        else:
            child.text = " ".join(numbers)

    return write


def _tag(name: str) -> str:
    prefix, colon, rest = name.partition(":")
    return f"{{{_NAMESPACES.get(prefix, prefix)}}}{rest}" if colon else name


def _plain_tag(element: Any) -> str:
    return str(element.tag).rpartition("}")[2]
