"""The true poses of table and tool by a world's `[mount]`, which the arm does not know.

World W of the plant is the frame of the table, its top at z = 0. The arm assumes that its base is W. In truth its base
B stands so that the table has the world's height and tilt in B.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from hw.collision import Table
from hw.types import Array
from sim.lab.world import Mount


def true_table(mount: Mount) -> Table:
    """The table top in the arm's base frame."""
    return Table(1e-3 * mount.table_height_mm, *(1e-3 * slope for slope in mount.table_tilt_mrad))


def X_WB(mount: Mount) -> Array:
    """(4, 4) the arm's base in the world."""
    return np.asarray(np.linalg.inv(true_table(mount).X_BW))


def X_FT(designed: Array, mount: Mount) -> Array:
    """(4, 4) the tool's true pose in the flange, from its `designed` pose."""
    off = np.eye(4)
    off[:3, :3] = Rotation.from_euler("x", 1e-3 * mount.tool_roll_mrad).as_matrix()
    off[2, 3] = 1e-3 * mount.tool_height_mm
    return np.asarray(designed @ off)
