"""Neck and handle of the turner: the parts of the spatula that must stay clear of arm and table.

The blade is not among them: it slides on the table, and the motion's contact window limits it.
"""

from __future__ import annotations

import numpy as np

from hw.collision import Capsule
from hw.kinematics import FLANGE
from hw.types import Array
from perception.blade import BLADE_LENGTH_M
from sim.tasks.scooping.params import EDGE_M, GRIP_M, HANDLE_RISE_RAD

NECK_M = 0.05
NECK_SIZE_M = (NECK_M, 0.035, 0.004)
"""Length along the handle, width and thickness of the neck, which stops a piece that rolls down to the blade's root."""

HANDLE_M = GRIP_M + 0.03 - NECK_M
ROOT_M: Array = np.array([-BLADE_LENGTH_M, 0.0, -EDGE_M / 2])
"""The point where the neck meets the blade, in T."""

UP: Array = np.array([-np.cos(HANDLE_RISE_RAD), 0.0, np.sin(HANDLE_RISE_RAD)])
"""Direction along the handle, in T."""

KEEP_CLEAR = (
    Capsule("neck of the spatula", FLANGE, ROOT_M + 0.02 * UP, ROOT_M + NECK_M * UP, 0.005),
    Capsule("handle of the spatula", FLANGE, ROOT_M + NECK_M * UP, ROOT_M + (NECK_M + HANDLE_M) * UP, 0.015),
)
