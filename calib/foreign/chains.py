"""Forward kinematics of any arm, from a table of Denavit-Hartenberg parameters or a URDF.

Only the chain from base to tip counts. Each of its moving joints takes one number, in order from the base.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from calib.errors import ViewFolderError
from calib.files import known_arm
from calib.geometry import pose
from calib.records import SetupRecord
from calib.types import Forward
from hw.bounded import Unreadable, read_bytes
from hw.types import Array, frozen_array

URDF_BYTES = 8 * 2**20
_TURNING, _SLIDING, _RIGID = ("revolute", "continuous"), ("prismatic",), ("fixed",)


@dataclass(frozen=True, eq=False)
class Link:
    """A constant pose, then a rotation about or a translation along an axis; a rigid joint has none."""

    X: Array  # (4, 4)
    axis: Array  # (3,) of length 1
    kind: Literal["turning", "sliding", "rigid"]


def any_arm(record: SetupRecord, folder: Path) -> tuple[Forward | None, int]:
    """Forward kinematics of the views' arm and its number of joints; None and 0 if unknown. Raises ViewFolderError."""
    kinematics = record.kinematics
    if kinematics is None:
        return known_arm(record, folder)
    if kinematics.dh is not None:
        assert kinematics.dh_convention is not None  # checked by the record
        return denavit_hartenberg(kinematics.dh, kinematics.dh_convention)
    assert kinematics.urdf is not None
    return urdf(folder / kinematics.urdf, kinematics.base, kinematics.tip)


def denavit_hartenberg(rows: Sequence[Sequence[float]], convention: Literal["craig", "classic"]) -> tuple[Forward, int]:
    """Rows of (a m, alpha rad, d m, theta rad), all joints revolute -> forward kinematics, and the number of joints.

    craig: Rot_x(alpha) Trans_x(a) Rot_z(theta + q) Trans_z(d) ("modified"); classic: Rot_z Trans_z Trans_x Rot_x.
    A row without a moving joint (a flange) has a fifth number 0.
    """
    z = np.array([0.0, 0.0, 1.0])
    links = []
    for row in rows:
        if len(row) not in (4, 5):
            raise ValueError("a row of dh is [a m, alpha rad, d m, theta rad], and 0 after it where nothing moves")
        a, alpha, d, theta = row[:4]
        across = pose(Rotation.from_rotvec([alpha, 0.0, 0.0]).as_matrix(), (a, 0.0, 0.0))
        along = pose(Rotation.from_rotvec([0.0, 0.0, theta]).as_matrix(), (0.0, 0.0, d))
        kind: Literal["turning", "rigid"] = "rigid" if len(row) == 5 and row[4] == 0 else "turning"
        if convention == "craig":  # a rotation about Z and a shift along Z commute
            links.append(Link(across @ along, z, kind))
        else:
            links += [Link(np.eye(4), z, kind), Link(along @ across, z, "rigid")]
    return _forward(links)


def urdf(path: Path, base: str | None, tip: str | None) -> tuple[Forward, int]:
    """The chain between two links of a URDF; by default its root and its only end. Raises ViewFolderError."""
    try:
        robot = ElementTree.fromstring(read_bytes(path, URDF_BYTES))
    except (FileNotFoundError, Unreadable, ElementTree.ParseError) as error:
        raise ViewFolderError(f"{path} cannot be read as URDF ({error})") from error
    joints = {_attribute(joint, "child", "link"): joint for joint in robot.findall("joint")}
    parents = {child: _attribute(joint, "parent", "link") for child, joint in joints.items()}
    if tip is None:
        ends = sorted(set(parents) - set(parents.values()))
        if len(ends) != 1:
            raise ViewFolderError(f"{path} has {len(ends)} end links ({', '.join(ends[:8])}): name one as tip")
        tip = ends[0]
    chain, link = list[ElementTree.Element](), tip
    while link != base and link in joints:
        if len(chain) == len(joints):
            raise ViewFolderError(f"{path}: the links above {tip} form a circle, so the arm has no root")
        chain.append(joints[link])
        link = parents[link]
    if (base is not None and link != base) or not chain:
        raise ViewFolderError(f"{path} has no chain from {base or 'its root'} to {tip}: check base and tip")
    return _forward([_link(joint, path) for joint in reversed(chain)])


def _link(joint: ElementTree.Element, path: Path) -> Link:
    origin, axis = joint.find("origin"), joint.find("axis")
    xyz = _numbers(origin, "xyz", "0 0 0")
    rpy = _numbers(origin, "rpy", "0 0 0")
    direction = _numbers(axis, "xyz", "1 0 0")
    kind = joint.get("type", "")
    if joint.find("mimic") is not None or kind not in (*_TURNING, *_SLIDING, *_RIGID):
        raise ViewFolderError(f"{path}: joint {joint.get('name')} is of an unsupported kind ({kind}, or mimic)")
    name: Literal["turning", "sliding", "rigid"] = (
        "turning" if kind in _TURNING else "sliding" if kind in _SLIDING else "rigid"
    )
    length = float(np.linalg.norm(direction)) or 1.0
    return Link(pose(Rotation.from_euler("xyz", rpy).as_matrix(), xyz), direction / length, name)


def _attribute(joint: ElementTree.Element, tag: str, name: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get(name, "")


def _numbers(element: ElementTree.Element | None, name: str, default: str) -> Array:
    text = default if element is None else element.get(name, default)
    try:
        return frozen_array([float(word) for word in text.split()], (3,), name)
    except ValueError as error:
        raise ViewFolderError(f"the URDF holds {text[:40]!r} where three numbers belong") from error


def _forward(links: Sequence[Link]) -> tuple[Forward, int]:
    count = sum(link.kind != "rigid" for link in links)

    def forward(q: Array) -> Array:
        q = np.asarray(q, dtype=np.float64)
        if q.shape[-1:] != (count,):
            raise ValueError(f"joints have shape {q.shape}, this arm has {count}")
        X = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
        at = 0
        for link in links:
            X = X @ link.X
            if link.kind == "rigid":
                continue
            step = np.zeros((*q.shape[:-1], 4, 4))
            step[...] = np.eye(4)
            if link.kind == "turning":
                turns = (q[..., at, None] * link.axis).reshape(-1, 3)
                step[..., :3, :3] = Rotation.from_rotvec(turns).as_matrix().reshape(*q.shape[:-1], 3, 3)
            else:
                step[..., :3, 3] = q[..., at, None] * link.axis
            X = X @ step
            at += 1
        return np.ascontiguousarray(X)

    return forward, count
