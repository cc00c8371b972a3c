"""The mass of the pusher, in its frame T: that of the scene, spread evenly over plate, stem and block."""

from __future__ import annotations

import math

import numpy as np

from hw.mass import bar, box
from sim.tasks.pushing.mount import (
    BLOCK_M,
    GRIP_M,
    PLATE_HEIGHT_M,
    PLATE_THICKNESS_M,
    PLATE_WIDTH_M,
    ROOT_M,
    STEM_M,
    block_axes,
)
from sim.tasks.pushing.scene import PLATE_MASS_KG

_PLATE_M = (PLATE_THICKNESS_M, PLATE_WIDTH_M, PLATE_HEIGHT_M)
_PLATE_M3, _BLOCK_M3 = math.prod(_PLATE_M), math.prod(BLOCK_M)
_STEM_M3 = STEM_M**2 * float(np.linalg.norm(GRIP_M - ROOT_M))
_KG_M3 = PLATE_MASS_KG / (_PLATE_M3 + _STEM_M3 + _BLOCK_M3)

_X_TB = np.eye(4)
_X_TB[:3, :3], _X_TB[:3, 3] = block_axes(), GRIP_M

TOOL_MASS = (
    box(_KG_M3 * _PLATE_M3, _PLATE_M, (-PLATE_THICKNESS_M / 2, 0.0, PLATE_HEIGHT_M / 2))
    + bar(_KG_M3 * _STEM_M3, ROOT_M, GRIP_M, STEM_M)
    + box(_KG_M3 * _BLOCK_M3, BLOCK_M, (0.0, 0.0, 0.0)).placed(_X_TB)
)
