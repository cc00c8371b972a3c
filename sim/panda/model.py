"""The arm in Drake: a URDF written from the published kinematics and inertia and our own primitive shapes.

Links `panda_link0` to `panda_link7`, `panda_flange` (frame F) and `panda_hand`; joints and actuators
`panda_joint1` to `panda_joint7`. The link frames are those of `hw.kinematics`. There is no collision geometry:
paths are checked beforehand by `hw.collision`, and the tool brings its own.

Sources: frames from the maker's Denavit-Hartenberg table; masses, centres of mass and inertia are those of
`hw.dynamics`; torque limits from the maker's specification.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from hw.collision import HAND_MASS
from hw.dynamics import LINKS
from hw.joint_limits import LIMITS, JointLimits
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
    """The arm as URDF text with joint limits, masses and inertia of `model` (a key of `LIMITS`)."""
    limits = LIMITS[model]
    robot = Element("robot", name=model)
    for i, link in enumerate(LINKS[model]):
        _add_link(robot, f"panda_link{i}", link)
    _add_link(robot, HAND_NAME, HAND_MASS)
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


BRANCHES = 4

_SHOULDER = np.array([0.0, 0.0, D1_M])
_CENTRE = np.array([0.0, 0.0, 0.0, -np.pi / 2, 0.0, 1.9, 0.0])  # angles lie within half a turn of these
_UPPER2, _FORE2 = A4_M**2 + D3_M**2, A4_M**2 + D5_M**2
_COS4, _SIN4 = A4_M**2 - D3_M * D5_M, A4_M * (D3_M + D5_M)


def inverse(X_BF: Array, q7_rad: Array) -> Array:
    """Flange poses (..., 4, 4) and joint 7 (...) -> (..., 4, 7) joint positions, one row per branch.

    The leading axes broadcast. An unreachable branch is NaN. Position limits are not checked, but every angle is given
    in the turn that contains its range. A branch followed along a path is continuous.
    """
    R, p = X_BF[..., :3, :3], X_BF[..., :3, 3]
    c7, s7 = np.cos(q7_rad)[..., None], np.sin(q7_rad)[..., None]
    x6 = c7 * R[..., :, 0] - s7 * R[..., :, 1]
    y6 = np.broadcast_to(-R[..., :, 2], x6.shape)
    to_shoulder = _SHOULDER - (p - FLANGE_M * R[..., :, 2] - A7_M * x6)  # from the wrist
    with np.errstate(invalid="ignore"):
        q4 = _elbow(np.einsum("...i,...i->...", to_shoulder, to_shoulder))
        q6 = _wrist(q4, _dot(to_shoulder, x6), _dot(to_shoulder, y6))  # (..., 2)
    q4 = np.broadcast_to(q4[..., None], q6.shape)
    c4, s4, c6, s6 = (v[..., None] for v in (np.cos(q4), np.sin(q4), np.cos(q6), np.sin(q6)))
    x6, y6, to_shoulder = x6[..., None, :], y6[..., None, :], to_shoulder[..., None, :]

    x5, y4 = c6 * x6 - s6 * y6, s6 * x6 + c6 * y6  # frame 5: its Z axis is the Y axis of frame 4
    x4 = (to_shoulder - _along_y4(c4, s4) * y4) / (A4_M * (1.0 - c4) - D3_M * s4)
    z4 = np.cross(x4, y4)
    q5 = np.arctan2(-_dot(x5, z4), _dot(x5, x4))
    x3, z3 = c4 * x4 - s4 * y4, s4 * x4 + c4 * y4

    side = np.array([1.0, -1.0])
    q1 = np.arctan2(side * z3[..., 1, None], side * z3[..., 0, None])  # (..., 2, 2): wrist side, shoulder side
    q2 = np.arctan2(side * np.hypot(z3[..., 0], z3[..., 1])[..., None], z3[..., 2, None])
    c1, s1, c2, s2 = np.cos(q1), np.sin(q1), np.cos(q2), np.sin(q2)
    x2 = np.stack([c2 * c1, c2 * s1, -s2], axis=-1)
    z2 = np.stack([-s1, c1, np.zeros_like(c1)], axis=-1)
    q3 = np.arctan2(_dot(x3[..., None, :], z2), _dot(x3[..., None, :], x2))

    shape = q3.shape
    both = [np.broadcast_to(v[..., None], shape) for v in (q4, q5, q6)]
    q7 = np.broadcast_to(np.asarray(q7_rad, dtype=np.float64)[..., None, None], shape)
    q = np.stack([q1, q2, q3, *both, q7], axis=-1).reshape(*shape[:-2], BRANCHES, 7)
    q[..., :6] = _CENTRE[:6] + _wrap(q[..., :6] - _CENTRE[:6])
    return q


def postures(X_BF: Array, limits: JointLimits, count: int, ratio: float = np.inf) -> Array:
    """(N, 7) all postures with the flange at one of the poses (..., 4, 4), over `count` - 2 positions of joint 7.

    `ratio` is the largest allowed share of a joint's position limits.
    """
    q7 = np.linspace(limits.q_min_rad[6], limits.q_max_rad[6], count)[1:-1]
    q = inverse(X_BF[..., None, :, :], q7).reshape(-1, 7)
    q = q[np.isfinite(q).all(axis=1)]
    still = np.zeros_like(q)
    return np.asarray(q[limits.ratios(q, still, still)[0].max(axis=1) <= ratio])


def _elbow(distance2: Array) -> Array:
    """Squared distance between shoulder and wrist -> joint 4 in (-3.61, -0.47), NaN out of reach."""
    cosine = (_UPPER2 + _FORE2 - distance2) / 2.0 / np.hypot(_COS4, _SIN4)
    return np.asarray(np.arctan2(_SIN4, _COS4) + np.arccos(cosine) - 2.0 * np.pi)


def _wrist(q4: Array, along_x6: Array, along_y6: Array) -> Array:
    """The two joints 6 (..., 2) for which the forearm makes the right angle with the line to the shoulder."""
    goal = _along_y4(np.cos(q4), np.sin(q4))
    spread = np.arccos(goal / np.hypot(along_x6, along_y6))
    middle = np.arctan2(along_x6, along_y6)
    return np.stack([middle - spread, middle + spread], axis=-1)


def _along_y4(c4: Array, s4: Array) -> Array:
    """Component of the line from wrist to shoulder along the forearm (Y axis of frame 4)."""
    return -D5_M + A4_M * s4 - D3_M * c4


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _wrap(angle: Array) -> Array:
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))
