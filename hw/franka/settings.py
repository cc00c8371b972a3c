"""A lab's settings of its Franka arm, checked once.

The real-time kernel is not a setting: it is always required.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import HAND_MASS
from hw.franka.starting import Starting
from hw.mass import Mass, inertia
from hw.motion_limits import RATED_NM, TORQUE_SHARE
from hw.types import Array, frozen_array, number
from hw.workcell import STOPS_AT_N, STOPS_AT_NM

HIGHEST_PAYLOAD_KG = 3.0
"""The largest load of all three arms, hand included (the maker's data sheets)."""

FARTHEST_M = 1.0
"""No payload has its centre of mass farther from the flange."""

STIFFEST_NM_RAD = 14250.0
"""Highest joint impedance that the arm accepts (libfranka, `setJointImpedance`)."""

MOST_NM: Array = frozen_array(TORQUE_SHARE * RATED_NM)
"""(7,) the highest threshold of each joint: the share of its rating that a motion may use."""

MOST_FORCE_N = 100.0
"""A higher collision threshold would never stop anything."""


@dataclass(frozen=True, eq=False)
class Payload:
    """The load in the hand, in the flange frame F. The hand itself is set on the arm's web page (Desk)."""

    mass_kg: float = 0.0
    com_F_m: Array = field(default_factory=lambda: np.zeros(3))  # (3,) centre of mass
    inertia_F_kg_m2: Array = field(default_factory=lambda: np.zeros((3, 3)))  # (3, 3) about the centre of mass

    def __post_init__(self) -> None:
        """Raises ValueError for a load that is too heavy or has an inertia that no body has."""
        number(self.mass_kg, "mass of the payload", 0.0, HIGHEST_PAYLOAD_KG, "kg")
        com_F_m = frozen_array(self.com_F_m, (3,), "centre of mass of the payload", most=FARTHEST_M)
        object.__setattr__(self, "com_F_m", com_F_m)
        object.__setattr__(self, "inertia_F_kg_m2", inertia(self.inertia_F_kg_m2, "inertia of the payload"))


@dataclass(frozen=True, eq=False)
class CollisionThresholds:
    """Above `contact` the arm reports a contact; above `collision` it stops with a reflex.

    The same values hold while it accelerates. Each joint's threshold is at most `MOST_NM`; at its rated torque it would
    never stop anything. The defaults of joints 1 to 4 are the maker's example, times one and times three.
    """

    torque_contact_Nm: Array = field(default_factory=lambda: np.array([20.0, 20.0, 18.0, 18.0, 8.0, 8.0, 8.0]))
    torque_collision_Nm: Array = field(default_factory=lambda: np.array(STOPS_AT_NM))
    force_contact_N: Array = field(default_factory=lambda: np.array([20.0, 20.0, 20.0, 25.0, 25.0, 25.0]))
    force_collision_N: Array = field(default_factory=lambda: np.array([*[STOPS_AT_N] * 3, 40.0, 40.0, 40.0]))
    # (6,): force along X, Y, Z in N and moment about them in Nm, on the tool

    def __post_init__(self) -> None:
        """Raises ValueError for a threshold that is not above 0 or is too high to stop anything, and for a contact
        threshold above that of a collision.
        """
        for name, size, most in (
            ("torque_contact_Nm", 7, MOST_NM),
            ("torque_collision_Nm", 7, MOST_NM),
            ("force_contact_N", 6, np.full(6, MOST_FORCE_N)),
            ("force_collision_N", 6, np.full(6, MOST_FORCE_N)),
        ):
            _positive(self, name, size, most)
        for kind, unit in (("torque", "Nm"), ("force", "N")):
            contact, collision = getattr(self, f"{kind}_contact_{unit}"), getattr(self, f"{kind}_collision_{unit}")
            if (contact > collision).any():
                raise ValueError(
                    f"{kind} thresholds: contact {contact.tolist()} is above collision {collision.tolist()} {unit}; "
                    "the contact threshold must not be above the collision threshold"
                )

    @property
    def contact_force_limit_N(self) -> float:
        """The force along any axis at which the arm stops."""
        return float(self.force_collision_N[:3].min())


@dataclass(frozen=True, eq=False)
class FrankaSettings:
    """One arm: address, payload, thresholds at which it stops by itself, joint impedance."""

    host: str
    payload: Payload = field(default_factory=Payload)
    collision: CollisionThresholds = field(default_factory=CollisionThresholds)
    joint_impedance_Nm_rad: Array = field(
        default_factory=lambda: np.array([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
    )
    """(7,) the arm's own default."""
    end_effector: Mass = HAND_MASS
    """The end effector that Desk has to hold: everything on the flange but the payload."""
    starting: Starting = field(default_factory=Starting)

    def __post_init__(self) -> None:
        """Raises ValueError naming the setting."""
        if not self.host.strip() or any(c.isspace() or c in "/:" for c in self.host):
            raise ValueError(
                f"address of the arm {self.host!r}: give only the name or IP address, without https:// or a port, "
                "for example 172.16.0.2"
            )
        _positive(self, "joint_impedance_Nm_rad", 7, np.full(7, STIFFEST_NM_RAD))


def _positive(owner: object, name: str, size: int, most: Array) -> None:
    value: ArrayLike = getattr(owner, name)
    array = frozen_array(value, (size,), name)
    if not ((array > 0.0) & (array <= most)).all():
        limits = ", ".join(f"{value:g}" for value in dict.fromkeys(most.tolist()))
        where = int(np.flatnonzero(~((array > 0.0) & (array <= most)))[0])
        raise ValueError(
            f"{name} {array.tolist()}: every value must be above 0 and at most {limits}; value {where + 1} is "
            f"{array[where]:g}, its limit {most[where]:g}"
        )
    object.__setattr__(owner, name, array)
