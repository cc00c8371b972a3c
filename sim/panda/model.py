"""The arm in Drake: a URDF written from the published kinematics and inertia and our own primitive shapes.

Links `panda_link0` to `panda_link7`, `panda_flange` (frame F) and `panda_hand`; joints and actuators
`panda_joint1` to `panda_joint7`. The link frames are those of `hw.kinematics`. There is no collision geometry:
paths are checked beforehand against the capsules of `hw.collision`, and the tool brings its own.

Sources: frames from the maker's Denavit-Hartenberg table; masses, centres of mass and inertia are those of
`hw.dynamics`; torque limits from the maker's specification.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from hw.collision import HAND_MASS
from hw.dynamics import LINKS
from hw.joint_limits import LIMITS
from hw.kinematics import A4_M, A7_M, D1_M, D3_M, D5_M, FLANGE_M
from hw.mass import Mass
from hw.motion_limits import RATED_NM
from hw.types import Array
from sim.panda.shapes import PRIMITIVES, Primitive

if TYPE_CHECKING:
    import pydrake.multibody.plant as drake_plant
    import pydrake.multibody.tree as drake_tree

JOINT_NAMES = tuple(f"panda_joint{i}" for i in range(1, 8))
FLANGE_NAME = "panda_flange"
HAND_NAME = "panda_hand"

_HALF_PI = "1.5707963267948966"


_BODIES = (*((f"panda_link{i}", link) for i, link in enumerate(LINKS)), (HAND_NAME, HAND_MASS))

# origin and roll of each joint in the link before it
_JOINTS = (
    ((0.0, 0.0, D1_M), "0"),
    ((0.0, 0.0, 0.0), f"-{_HALF_PI}"),
    ((0.0, -D3_M, 0.0), _HALF_PI),
    ((A4_M, 0.0, 0.0), _HALF_PI),
    ((-A4_M, D5_M, 0.0), f"-{_HALF_PI}"),
    ((0.0, 0.0, 0.0), _HALF_PI),
    ((A7_M, 0.0, 0.0), _HALF_PI),
)


def add_panda(
    plant: drake_plant.MultibodyPlant, model: str = "panda", X_WB: Array | None = None
) -> drake_tree.ModelInstanceIndex:
    """Add the arm with its hand, the base welded at `X_WB` (4, 4) in the world; weld tools to the frame `panda_flange`.

    The plant's positions of the returned instance are the seven joints in order.
    """
    from pydrake.math import RigidTransform  # noqa: PLC0415
    from pydrake.multibody.parsing import Parser  # noqa: PLC0415

    instance: drake_tree.ModelInstanceIndex = Parser(plant).AddModelsFromString(urdf(model), "urdf")[0]
    base = RigidTransform() if X_WB is None else RigidTransform(X_WB)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("panda_link0", instance), base)
    return instance


def urdf(model: str = "panda") -> str:
    """The arm as URDF text with the joint limits of `model` ("panda" or "fr3")."""
    limits = LIMITS[model]
    robot = Element("robot", name=model)
    for name, mass in _BODIES:
        _add_link(robot, name, mass)
    for i, (origin, roll) in enumerate(_JOINTS):
        links = (f"panda_link{i}", f"panda_link{i + 1}")
        joint = _add_joint(robot, JOINT_NAMES[i], "revolute", links, (origin, f"{roll} 0 0"))
        SubElement(joint, "axis", xyz="0 0 1")
        SubElement(
            joint,
            "limit",
            lower=str(limits.q_min_rad[i]),
            upper=str(limits.q_max_rad[i]),
            velocity=str(limits.dq_max_rad_s[i]),
            effort=str(float(RATED_NM[i])),
        )
        drive = SubElement(robot, "transmission", name=f"{JOINT_NAMES[i]}_drive")
        SubElement(drive, "type").text = "transmission_interface/SimpleTransmission"
        SubElement(drive, "joint", name=JOINT_NAMES[i])
        SubElement(drive, "actuator", name=JOINT_NAMES[i])
    SubElement(robot, "link", name=FLANGE_NAME)
    to_flange, to_hand = ((0.0, 0.0, FLANGE_M), "0 0 0"), ((0.0, 0.0, 0.0), f"0 0 {-np.pi / 4}")
    _add_joint(robot, "panda_flange_joint", "fixed", ("panda_link7", FLANGE_NAME), to_flange)
    _add_joint(robot, "panda_hand_joint", "fixed", (FLANGE_NAME, HAND_NAME), to_hand)
    indent(robot)
    return tostring(robot, encoding="unicode")


def _add_link(robot: Element, link: str, mass: Mass) -> None:
    element = SubElement(robot, "link", name=link)
    inertial = SubElement(element, "inertial")
    SubElement(inertial, "origin", xyz=_text(tuple(mass.com_m.tolist())), rpy="0 0 0")
    SubElement(inertial, "mass", value=str(mass.kg))
    names, inertia = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), mass.inertia_kg_m2
    values = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
    SubElement(inertial, "inertia", {name: str(float(v)) for name, v in zip(names, values, strict=True)})
    for primitive in PRIMITIVES:
        if primitive.link == link:
            _add_visual(element, primitive)


def _add_visual(link: Element, primitive: Primitive) -> None:
    visual = SubElement(link, "visual")
    turn = {"x": f"0 {_HALF_PI} 0", "y": f"-{_HALF_PI} 0 0", "z": "0 0 0"}[primitive.axis]
    SubElement(visual, "origin", xyz=_text(primitive.centre), rpy=turn)
    geometry = SubElement(visual, "geometry")
    match primitive.kind:
        case "box":
            SubElement(geometry, "box", size=_text(primitive.size))
        case "sphere":
            SubElement(geometry, "sphere", radius=str(primitive.size[0]))
        case "cylinder":
            SubElement(geometry, "cylinder", radius=str(primitive.size[0]), length=str(primitive.size[1]))
    material = SubElement(visual, "material", name=f"rgb_{'_'.join(f'{100 * c:.0f}' for c in primitive.rgb)}")
    SubElement(material, "color", rgba=f"{_text(primitive.rgb)} 1")


def _add_joint(
    robot: Element, name: str, kind: str, links: tuple[str, str], pose: tuple[tuple[float, ...], str]
) -> Element:
    """A joint between parent and child `links`; `pose` is origin and roll, pitch, yaw in the parent."""
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=links[0])
    SubElement(joint, "child", link=links[1])
    SubElement(joint, "origin", xyz=_text(pose[0]), rpy=pose[1])
    return joint


def _text(values: tuple[float, ...]) -> str:
    return " ".join(str(v) for v in values)
