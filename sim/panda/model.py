"""The arm in Drake: a URDF written from the published kinematics and inertia and our own primitive shapes.

Links `panda_link0` to `panda_link7`, `panda_flange` (frame F) and `panda_hand`; joints and actuators
`panda_joint1` to `panda_joint7`. The link frames are those of `hw.kinematics`. There is no collision geometry:
paths are checked beforehand against the capsules of `hw.collision`, and the tool brings its own.

Sources: frames from the maker's Denavit-Hartenberg table; masses, centres of mass and inertia from the maker's
robot description, which cites Gaz et al., "Dynamic identification of the Franka Emika Panda robot with
retrieval of feasible parameters" (2019); torque limits from the maker's specification.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from hw.joint_limits import LIMITS
from hw.kinematics import A4_M, A7_M, D1_M, D3_M, D5_M, FLANGE_M
from hw.types import Array
from sim.panda.shapes import PRIMITIVES, Primitive

if TYPE_CHECKING:
    import pydrake.multibody.plant as drake_plant
    import pydrake.multibody.tree as drake_tree

JOINT_NAMES = tuple(f"panda_joint{i}" for i in range(1, 8))
FLANGE_NAME = "panda_flange"
HAND_NAME = "panda_hand"
TORQUE_NM = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)

_HALF_PI = "1.5707963267948966"


@dataclass(frozen=True)
class _Link:
    """A moving part: inertia about its centre of mass in the link's axes, xx yy zz xy xz yz in kg m²."""

    name: str
    mass_kg: float
    com_m: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]


_LINKS = (
    _Link(
        "panda_link0",
        0.629769,
        (-0.041018, -0.00014, 0.049974),
        (0.00315, 0.00388, 0.004285, 8.2904e-7, 0.00015, 8.2299e-6),
    ),
    _Link(
        "panda_link1",
        4.970684,
        (0.003875, 0.002081, -0.04762),
        (0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169),
    ),
    _Link(
        "panda_link2",
        0.646926,
        (-0.003141, -0.02872, 0.003495),
        (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704),
    ),
    _Link(
        "panda_link3",
        3.228604,
        (0.027518, 0.039252, -0.066502),
        (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805),
    ),
    _Link(
        "panda_link4",
        3.587895,
        (-0.05317, 0.104419, 0.027454),
        (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641),
    ),
    _Link(
        "panda_link5",
        1.225946,
        (-0.011953, 0.041065, -0.038437),
        (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229),
    ),
    _Link(
        "panda_link6",
        1.666555,
        (0.060149, -0.014117, -0.010517),
        (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341),
    ),
    _Link(
        "panda_link7",
        0.735522,
        (0.010517, -0.004252, 0.061597),
        (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741),
    ),
    _Link(HAND_NAME, 0.73, (-0.01, 0.0, 0.03), (0.001, 0.0025, 0.0017, 0.0, 0.0, 0.0)),
)

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
    for link in _LINKS:
        _add_link(robot, link)
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
            effort=str(TORQUE_NM[i]),
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


def _add_link(robot: Element, link: _Link) -> None:
    element = SubElement(robot, "link", name=link.name)
    inertial = SubElement(element, "inertial")
    SubElement(inertial, "origin", xyz=_text(link.com_m), rpy="0 0 0")
    SubElement(inertial, "mass", value=str(link.mass_kg))
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    SubElement(inertial, "inertia", {name: str(v) for name, v in zip(names, link.inertia, strict=True)})
    for primitive in PRIMITIVES:
        if primitive.link == link.name:
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
