"""Finds the model of the connected arm, and the limits of its joints, from the arm's own report.

* The version of its research interface distinguishes a Panda (5) from both FR3s (10). libfranka refuses every version
  but its own.
* libfranka builds its dynamics from the description (URDF) that an FR3 sends. Its mass matrix tells FR3 and FR3 v2
  apart: their moving masses are 15.5 and 13.5 kg, and their mass matrices differ by 4 % in the ready posture.
* Where the SDK hands out that description, the robot's name in it has to agree, and its joint limits count.
  `pylibfranka` 0.21.3 does not.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from xml.etree import ElementTree as ET

import numpy as np

from hw.dynamics import torque_Nm
from hw.franka.versions import PACKAGES
from hw.joint_limits import JointLimits
from hw.kinematics import JOINTS
from hw.mass import NOTHING, Mass
from hw.types import Array

TITLES = {"panda": "a Panda (Franka Emika Robot)", "fr3": "an FR3", "fr3v2": "an FR3 v2"}
ALIKE = 0.02
"""Relative difference of two mass matrices up to which they are of one arm: half of that between FR3 and FR3 v2."""
CLEAR = 3.0
"""A mass matrix has to be this many times nearer to its model than to every other one."""
SAME_LIMIT = 1e-3
"""Joint limits (rad, rad/s) that differ by less count as equal, because they are rounded."""
LONGEST_URDF = 1_000_000
"""Characters; an FR3's description has 10,000."""


@dataclass(frozen=True, eq=False)
class ArmReport:
    """The report of an arm at rest about itself."""

    q_rad: Array = field(default_factory=lambda: np.zeros(JOINTS))  # (7,) at which `mass_kg_m2` holds
    mass_kg_m2: Array | None = None  # (7, 7) its mass matrix with its load; None: not reported
    load: Mass = NOTHING  # on the flange, hand included, as the arm counts it
    urdf: str = ""  # empty: the SDK does not hand it out


@dataclass(frozen=True)
class Identity:
    """The model of an arm by its own report; None if it is not recognised."""

    model: str | None
    why: str


def identify(configured: str, report: ArmReport) -> Identity:
    """The model of the connected arm, among those with the interface of the `configured` one."""
    interface = PACKAGES[configured].interface
    models = [name for name, package in PACKAGES.items() if package.interface == interface]
    if len(models) == 1:
        return Identity(models[0], f"it speaks interface version {interface}")
    name, by_mass = _name(report.urdf), _by_mass(models, report)
    reasons = (
        (name and name not in models, f"its own description calls it {name!r}, which this program does not know"),
        (
            by_mass is None and report.mass_kg_m2 is not None,
            f"its mass matrix is that of none of {', '.join(models)}",
        ),
        (
            name and by_mass not in (None, name),
            f"its own description calls it {name!r} and has the masses of {by_mass}",
        ),
        (not name and by_mass is None, "it reports neither masses nor a description"),
    )
    if why := next((why for holds, why in reasons if holds), ""):
        return Identity(None, why)
    if by_mass is None:
        return Identity(name, f"its own description calls it {name!r}")
    return Identity(by_mass, f"its mass matrix is that of {by_mass}")


def unsure(configured: str, identity: Identity) -> str:
    """The sentence for an operator if the model cannot be told from the arm's report."""
    return (
        f"the arm's report does not show its model ({identity.why}): compare its type plate with the rig file. The "
        f"limits, masses and shape of {TITLES[configured]} apply ({configured}); another model may need other torques"
    )


def _by_mass(models: list[str], report: ArmReport) -> str | None:
    if report.mass_kg_m2 is None:
        return None
    apart = sorted((_apart(mass_matrix(name, report.q_rad, report.load), report.mass_kg_m2), name) for name in models)
    (nearest, name), (second, _) = apart[:2]
    return name if nearest <= ALIKE and CLEAR * nearest <= second else None


def _apart(ours: Array, reported: Array) -> float:
    return float(np.linalg.norm(reported - ours) / np.linalg.norm(ours))


def mass_matrix(model: str, q_rad: Array, load: Mass) -> Array:
    """(7, 7) kg m² of the arm `model` with `load` (flange) at joints (7,)."""
    q, still, one = np.repeat(q_rad[None], JOINTS, axis=0), np.zeros((JOINTS, JOINTS)), np.eye(JOINTS)
    return np.asarray(torque_Nm(model, q, still, one, load) - torque_Nm(model, q, still, still, load))


def narrowed(limits: JointLimits, urdf: str) -> tuple[JointLimits, tuple[str, ...]]:
    """The narrower of `limits` and those of an arm's own description, and a sentence for each that differs.

    An empty description changes nothing. Raises ValueError for one that cannot be read.
    """
    if not urdf:
        return limits, ()
    rows = _joints(urdf)
    low, high = np.maximum(limits.q_min_rad, rows[:, 0]), np.minimum(limits.q_max_rad, rows[:, 1])
    fastest = np.minimum(limits.dq_max_rad_s, rows[:, 2])
    if not ((low < high) & (fastest > 0.0)).all():
        raise ValueError(f"its joint limits {rows.tolist()} leave no range")
    ours = np.stack([limits.q_min_rad, limits.q_max_rad, limits.dq_max_rad_s], axis=1)
    sentences = tuple(
        f"joint {i + 1}: the arm says {name} {rows[i, k]:.4f} {unit}, the table of {limits.model} {ours[i, k]:.4f}; "
        "the narrower counts"
        for i in range(JOINTS)
        for k, (name, unit) in enumerate((("at least", "rad"), ("at most", "rad"), ("at most", "rad/s")))
        if abs(rows[i, k] - ours[i, k]) >= SAME_LIMIT
    )
    return replace(limits, q_min_rad=low, q_max_rad=high, dq_max_rad_s=fastest), sentences


def _root(urdf: str) -> ET.Element:
    if len(urdf) > LONGEST_URDF or "<!" in re.sub(r"<!--.*?-->", "", urdf, flags=re.DOTALL):  # no entities
        raise ValueError("it is too long or has a document type of its own")
    try:
        return ET.fromstring(urdf)
    except ET.ParseError as error:
        raise ValueError(str(error)) from error


def _name(urdf: str) -> str:
    try:
        return _root(urdf).get("name", "") if urdf else ""
    except ValueError:
        return ""


def _joints(urdf: str) -> Array:
    """(7, 3) lower and upper limit in rad, velocity in rad/s, of joints 1 to 7."""
    rows: dict[int, list[float]] = {}
    for joint in _root(urdf).iter("joint"):
        match, limit = re.search(r"joint([1-7])$", joint.get("name", "")), joint.find("limit")
        if match and limit is not None:
            rows[int(match[1])] = [float(limit.get(key, "nan")) for key in ("lower", "upper", "velocity")]
    table = np.array([rows.get(i, [np.nan] * 3) for i in range(1, JOINTS + 1)])
    if not np.isfinite(table).all():
        raise ValueError("it does not limit all seven joints")
    return table
