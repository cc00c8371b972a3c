"""The pusher, a plate on a stem to be printed in one piece, and how the hand holds it.

The tool frame T is at the middle of the lower edge of the plate's front face: X forward out of the face, the way it
pushes, Y to the left, Z up along the plate.
"""

from __future__ import annotations

import numpy as np

from hw.collision import Capsule
from hw.kinematics import FLANGE
from hw.types import Array, frozen_array

PLATE_WIDTH_M = 0.12
PLATE_HEIGHT_M = 0.08
PLATE_THICKNESS_M = 0.005

ROOT_M: Array = frozen_array([-PLATE_THICKNESS_M, 0.0, 0.05], (3,))
"""The point where the stem meets the plate's back, in T."""

GRIP_M: Array = frozen_array([-0.074, 0.072, 0.125], (3,))
"""The middle of the block that the fingers hold, in T."""

STEM_M = 0.022
BLOCK_M = (0.024, 0.024, 0.036)
"""Edge lengths of stem and block; the block's last one runs along the hand."""

_LEAN_RAD, _TURN_RAD, _ROLL_RAD = 1.174, 1.237, -2.878
_FLANGE_TO_GRIP_M = 0.1034  # the Franka Hand's fingertips


def mounting() -> Array:
    """(4, 4) the tool in the flange.

    Grip, lean, turn and roll come from a joint search. It minimised the worst ratio of any joint of either arm to its
    limits over the action space (docs/decisions/0008).
    """
    return mount_in_hand(GRIP_M, _LEAN_RAD, _TURN_RAD, _ROLL_RAD)


def mount_in_hand(grip_m: Array, lean_rad: float, turn_rad: float, roll_rad: float) -> Array:
    """(4, 4) the tool in a flange whose hand holds it at `grip_m` (3,) in T.

    The hand comes from above, leaning `lean_rad` from straight down towards the heading `turn_rad` about Z; `roll_rad`
    rotates it about its own axis.
    """
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    approach = np.array([np.sin(lean_rad) * cos, np.sin(lean_rad) * sin, -np.cos(lean_rad)])
    across = np.array([sin, -cos, 0.0])
    along = np.cross(across, approach)
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    X_TF = np.eye(4)
    X_TF[:3, :3] = np.column_stack([c * along + s * across, c * across - s * along, approach])
    X_TF[:3, 3] = np.asarray(grip_m) - _FLANGE_TO_GRIP_M * approach
    return np.asarray(np.linalg.inv(X_TF))


def block_axes() -> Array:
    """(3, 3) the hand's axes in T: the fingers close along the second, the third runs along the hand."""
    half = np.sqrt(0.5)  # the hand is rotated by -45° against the flange
    return np.asarray(np.linalg.inv(mounting())[:3, :3] @ [[half, half, 0.0], [-half, half, 0.0], [0.0, 0.0, 1.0]])


def _rim(name: str, y_m: tuple[float, float], z_m: tuple[float, float]) -> Capsule:
    """A capsule along a border of the plate, as thick as the plate and inset by a radius, so that both end at the same
    place.
    """
    radius_m = PLATE_THICKNESS_M / 2
    start, end = (np.array([-radius_m, y, z]) for y, z in zip(y_m, z_m, strict=True))
    return Capsule(f"{name} of the plate", FLANGE, start, end, radius_m)


_SIDE_M, _LOW_M, _HIGH_M = (PLATE_WIDTH_M - PLATE_THICKNESS_M) / 2, PLATE_THICKNESS_M / 2, PLATE_HEIGHT_M - 0.0025

KEEP_CLEAR = (
    _rim("lower edge", (-_SIDE_M, _SIDE_M), (_LOW_M, _LOW_M)),
    _rim("upper edge", (-_SIDE_M, _SIDE_M), (_HIGH_M, _HIGH_M)),
    _rim("left side", (_SIDE_M, _SIDE_M), (_LOW_M, _HIGH_M)),
    _rim("right side", (-_SIDE_M, -_SIDE_M), (_LOW_M, _HIGH_M)),
    Capsule("stem of the pusher", FLANGE, ROOT_M, GRIP_M, STEM_M * np.sqrt(0.5)),
)
"""The parts of the pusher that must stay clear of arm and table, in T."""
