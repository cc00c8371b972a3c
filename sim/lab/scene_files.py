"""One trial as files that other programs load: its scene as SDFormat for Drake or MJCF for MuJoCo, its motion as JSON.

The SDFormat file is written from the plant that `BuildScene` makes, so every body, joint, shape and contact property is
that of training. SDFormat has no place for the time step, the contact law, and which model is weightless; `trial.json`
has them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from pydrake.geometry import Box, Convex, Cylinder, GeometryId, HalfSpace, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import DiscreteContactApproximation
from pydrake.multibody.tree import BodyIndex, Joint, RigidBody, SpatialInertia, WeldJoint

from hw.types import Array
from sim.errors import NoHardware
from sim.lab.physics import mjcf_of, simulate_of
from sim.tasks.shared.direct import Drake
from sim.tasks.shared.readings import Course, read
from sim.tasks.task import Task
from sim.types import Visual

FORMAT = 1
SCENE, TOOL, TABLE = "trial", "tool", "table"
"""Names of the whole scene and of two of its models: the carriage with the tool, and everything fixed. The object's
model has the name of its body."""
_AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class SceneTrial:
    """A trial of a task without an arm, all values in units; the nuisance is in the middle of its range."""

    task: Task
    parameters: Array  # (p,)
    context: Array  # (c,)
    action: Array  # (a,)

    def course(self) -> Course:
        """Drive, start and end of the motion. Raises NoHardware if the task has none."""
        hardware = self.task.require_hardware()
        if hardware.course is None:
            raise NoHardware(f"the task {self.task.name} does not say how a tool alone is driven: no scene to export")
        X_BO = hardware.rest_pose(self.context, self.parameters, self.nuisance, None)
        course: Course = hardware.course(hardware.plan(self.context, self.action), X_BO, self.nuisance, None)
        return course

    @property
    def nuisance(self) -> Array:
        """(n,)"""
        return self.task.nuisance.middle


def as_sdf(trial: SceneTrial, facts: Mapping[str, Any], notes: Sequence[str]) -> dict[str, bytes]:
    """Name -> content of each file; `facts` go into trial.json, `notes` into a comment. Raises NoHardware."""
    course, hardware = trial.course(), trial.task.require_hardware()
    dt_s = hardware.time_step_s(None)
    stepped = Drake(course, hardware.build_scene, dt_s, trial.parameters, trial.nuisance)
    writer = _Sdf(stepped, notes)
    law = stepped.plant.get_discrete_contact_approximation()
    end = read(stepped, course)
    motion = course.drive.trajectory
    start = {"t_s": course.start_s, "joints": course.tool[:3].tolist(), "rates": course.tool[3:].tolist()}
    details = {
        "time_step_s": dt_s,
        "contact": "sap" if law == DiscreteContactApproximation.kSap else "lagged",
        "weightless": f"{SCENE}::{TOOL}",
        "start": start,
        "motion": {
            "t_s": list(motion.get_segment_times()),
            "states": [motion.value(t)[:, 0].tolist() for t in motion.get_segment_times()],
        },
        "end": {"t_s": float(end.t_s[-1]), "body": stepped.bodies.object, "position_m": end.p_BO_m[-1].tolist()},
    }
    return {"scene.sdf": writer.text(), **writer.meshes, "trial.json": _json(facts, details)}


def as_mjcf(trial: SceneTrial, facts: Mapping[str, Any], notes: Sequence[str]) -> dict[str, bytes]:
    """The same for MuJoCo, in the scene of its foreign physics. Raises NoHardware, OutOfRange, ExtraMissing."""
    course = trial.course()
    text = mjcf_of(trial.task.name)(course, trial.parameters, trial.nuisance)
    arm, motion = course.drive.compliance, course.drive.trajectory
    states = np.array([motion.value(t)[:, 0] for t in motion.get_segment_times()])
    forces = states[:, :3] * np.array(arm.stiffness) + states[:, 3:] * np.array(arm.damping)
    end = simulate_of(trial.task.name, "mujoco")(trial.parameters, trial.context, trial.action, trial.nuisance)
    details = {
        "start": {"t_s": course.start_s, "keyframe": "start"},
        "motion": {"t_s": list(motion.get_segment_times()), "control": forces.tolist()},
        "end": {"t_s": float(end.t_s[-1]), "body": "object", "position_m": end.state[-1].tolist()},
    }
    head, root, rest = text.partition("<mujoco")
    comment = ElementTree.tostring(ElementTree.Comment("\n".join(["", *notes, ""])), "unicode")
    return {"scene.xml": f"{head}{comment}\n{root}{rest}".encode(), "trial.json": _json(facts, details)}


def _json(facts: Mapping[str, Any], details: Mapping[str, Any]) -> bytes:
    return (json.dumps({"format": FORMAT, **facts, **details}, allow_nan=False) + "\n").encode()


class _Sdf:
    """Writes a plant in its default state, with the object at the start of the trial."""

    def __init__(self, stepped: Drake, notes: Sequence[str]) -> None:
        self.meshes: dict[str, bytes] = {}
        self._plant, self._bodies = stepped.plant, stepped.bodies
        diagram: Any = stepped.simulator.get_system()
        self._inspector = diagram.scene_graph().model_inspector()
        self._through = {geometry for geometry, _ in self._bodies.apart}
        start = self._plant.GetMyContextFromRoot(stepped.simulator.get_context())
        zero = self._plant.CreateDefaultContext()
        self._root = ElementTree.Element("sdf", {"version": "1.11", "xmlns:drake": "http://drake.mit.edu"})
        self._root.append(ElementTree.Comment("\n".join(["", *notes, ""])))
        self._whole = _add(self._root, "model", name=SCENE)
        table, thing, tool = (_add(self._whole, "model", name=name) for name in (TABLE, self._bodies.object, TOOL))
        _add(table, "static", "true")
        for index in map(BodyIndex, range(self._plant.num_bodies())):
            body = self._plant.get_body(index)
            if body.is_floating_base_body():
                self._link(thing, body, body.EvalPoseInWorld(start))
            elif index == self._plant.world_body().index():
                self._link(table, body, RigidTransform())
            else:
                self._link(tool, body, body.EvalPoseInWorld(zero))
        for index in self._plant.GetJointIndices():
            if self._plant.get_joint(index).child_body().is_floating_base_body():
                continue
            self._joint(tool, self._plant.get_joint(index))
        self._keep_apart()

    def text(self) -> bytes:
        """The file."""
        ElementTree.indent(self._root)
        return bytes(ElementTree.tostring(self._root, "utf-8", xml_declaration=True)) + b"\n"

    def _link(self, model: Element, body: RigidBody, X_WB: RigidTransform) -> None:
        """A body with its mass and shapes. A shape that touches things through which the body's other shapes pass has
        its own link.
        """
        name = TABLE if body.name() == "world" else body.name()
        link = _add(model, "link", name=name)
        _pose(link, X_WB)
        if body.name() != "world":
            _inertial(link, body.default_spatial_inertia())
        shapes = self._plant.GetCollisionGeometriesForBody(body)
        through = [geometry for geometry in shapes if geometry in self._through]
        for geometry in shapes:
            owner = link
            if through and geometry not in through:
                owner = _add(model, "link", name=f"{name}_{self._inspector.GetName(geometry).rpartition('::')[2]}")
                _pose(owner, X_WB)
                _inertial(owner, SpatialInertia.Zero())
                _fixed(model, name, str(owner.get("name")))
            self._collision(owner, geometry)
        for i, visual in enumerate(v for v in self._bodies.visuals if v.body == body.name()):
            self._visual(link, f"{name}_looks_{i}", visual)

    def _collision(self, link: Element, geometry: GeometryId) -> None:
        name, shape = self._inspector.GetName(geometry).rpartition("::")[2], self._inspector.GetShape(geometry)
        collision = _add(link, "collision", name=name)
        _pose(collision, self._inspector.GetPoseInFrame(geometry))
        form = _add(collision, "geometry")
        if isinstance(shape, HalfSpace):
            plane = _add(form, "plane")
            _add(plane, "normal", "0 0 1")
            _add(plane, "size", "4 4")
        elif isinstance(shape, Box):
            _add(_add(form, "box"), "size", _text(shape.size()))
        elif isinstance(shape, Sphere):
            _add(_add(form, "sphere"), "radius", _text([shape.radius()]))
        elif isinstance(shape, Cylinder):
            cylinder = _add(form, "cylinder")
            _add(cylinder, "radius", _text([shape.radius()]))
            _add(cylinder, "length", _text([shape.length()]))
        else:
            mesh = _add(form, "mesh")
            _add(mesh, "uri", f"{name}.obj")
            if isinstance(shape, Convex):
                _add(mesh, "drake:declare_convex")
            self.meshes[f"{name}.obj"] = shape.source().in_memory().mesh_file.contents()
        self._properties(_add(collision, "drake:proximity_properties"), geometry)

    def _properties(self, element: Element, geometry: GeometryId) -> None:
        properties = self._inspector.GetProximityProperties(geometry)
        values = {
            key: value.get_value()
            for group in properties.GetGroupNames()
            for key, value in properties.GetPropertiesInGroup(group).items()
            if key != "compliance_type"  # unknown to Python; only a compliant shape has a modulus
        }
        if properties.HasGroup("hydroelastic"):
            soft = "hydroelastic_modulus" in values
            _add(element, "drake:compliant_hydroelastic" if soft else "drake:rigid_hydroelastic")
        for key, tag in _PROPERTIES.items():
            if key in values:
                _add(element, f"drake:{tag}", _text([values[key]]))
        friction = values["coulomb_friction"]
        _add(element, "drake:mu_dynamic", _text([friction.dynamic_friction()]))
        _add(element, "drake:mu_static", _text([friction.static_friction()]))

    def _visual(self, link: Element, name: str, visual: Visual) -> None:
        element = _add(link, "visual", name=name)
        _add(_add(_add(element, "geometry"), "mesh"), "uri", f"{name}.obj")
        lines = ["v " + _text(vertex) for vertex in visual.vertices_m]
        lines += ["f {} {} {}".format(*triangle) for triangle in visual.triangles + 1]
        self.meshes[f"{name}.obj"] = ("\n".join(lines) + "\n").encode()
        _add(_add(element, "material"), "diffuse", _text([*np.power(visual.rgb, 1.0 / 2.2), 1.0]))

    def _joint(self, model: Element, joint: Joint) -> None:
        parent, child = joint.parent_body().name(), joint.child_body().name()
        if isinstance(joint, WeldJoint):
            _fixed(model, parent, child)
            return
        element = _add(model, "joint", name=joint.name(), type=joint.type_name())
        _add(element, "parent", parent)
        _add(element, "child", child)
        axis: Any = joint
        along = axis.translation_axis() if joint.type_name() == "prismatic" else axis.revolute_axis()
        limit = _add(element, "axis")
        _add(limit, "xyz", _text(along))
        _add(_add(limit, "limit"), "effort", "-1")
        for index in self._plant.GetJointActuatorIndices():
            actuator = self._plant.get_joint_actuator(index)
            if actuator.joint().index() == joint.index():
                gains = actuator.get_controller_gains()
                _add(element, "drake:controller_gains", p=repr(gains.p), d=repr(gains.d))

    def _keep_apart(self) -> None:
        """Exclude contact between the table and those shapes of the tool that pass through it."""
        names = {self._plant.GetBodyFromFrameId(self._inspector.GetFrameId(g)).name() for g in self._through}
        riding, under = ("riding", [f"{TOOL}::{name}" for name in sorted(names)]), ("under", [f"{TABLE}::{TABLE}"])
        for (name, members), (other, _) in ((riding, under), (under, riding)) if names else ():
            group = _add(self._whole, "drake:collision_filter_group", name=name)
            for member in members:
                _add(group, "drake:member", member)
            _add(group, "drake:ignored_collision_filter_group", other)


_PROPERTIES = {
    "hydroelastic_modulus": "hydroelastic_modulus",
    "resolution_hint": "mesh_resolution_hint",
    "hunt_crossley_dissipation": "hunt_crossley_dissipation",
    "relaxation_time": "relaxation_time",
    "point_contact_stiffness": "point_contact_stiffness",
}
"""Drake's property -> its element in SDFormat."""


def _add(parent: Element, tag: str, text: str | None = None, **attributes: str) -> Element:
    element = ElementTree.SubElement(parent, tag, attributes)
    element.text = text
    return element


def _text(values: Any) -> str:
    """Numbers as text from which they can be read back exactly."""
    return " ".join(repr(float(value)) for value in values)


def _pose(parent: Element, X: RigidTransform) -> None:
    w, x, y, z = X.rotation().ToQuaternion().wxyz()
    _add(parent, "pose", _text([*X.translation(), x, y, z, w]), rotation_format="quat_xyzw")


def _fixed(model: Element, parent: str, child: str) -> None:
    joint = _add(model, "joint", name=f"{child}_weld", type="fixed")
    _add(joint, "parent", parent)
    _add(joint, "child", child)


def _inertial(link: Element, M: SpatialInertia) -> None:
    """Mass, centre of mass, and the inertia about it."""
    element = _add(link, "inertial")
    _add(element, "mass", _text([M.get_mass()]))
    _add(element, "pose", _text([*M.get_com(), 0.0, 0.0, 0.0]))
    central = (
        M.Shift(M.get_com()).CalcRotationalInertia().CopyToFullMatrix3() if M.get_mass() > 0.0 else np.zeros((3, 3))
    )
    inertia = _add(element, "inertia")
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        _add(inertia, f"i{_AXES[i]}{_AXES[j]}", _text([central[i, j]]))
