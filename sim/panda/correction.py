"""The result of a touch-off for planning: the table's pose and the tool's true pose in the hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from hw.collision import LEVEL, Table
from hw.types import Array
from sim.types import ToolMotion


@dataclass(frozen=True)
class ToolCorrection:
    """The measured corrections; the default is none.

    Those of the tool are in its designed frame T, about the origin of T.
    """

    table: Table = LEVEL
    height_m: float = 0.0  # along Z of T
    forward_m: float = 0.0  # along X of T
    pitch_rad: float = 0.0  # about Y of T; positive: edge down
    roll_rad: float = 0.0  # about X of T; positive: left side up

    def X_FT(self, designed: Array) -> Array:
        """(4, 4) the tool in the flange, from its `designed` pose."""
        off = np.eye(4)
        off[:3, :3] = Rotation.from_euler("XY", [self.roll_rad, self.pitch_rad]).as_matrix()
        off[:3, 3] = self.forward_m, 0.0, self.height_m
        return np.asarray(designed @ off)

    @property
    def X_BW(self) -> Array:
        """(4, 4) the table's frame W, used by tasks and cameras, in the arm's base B."""
        return self.table.X_BW

    @property
    def X_WB(self) -> Array:
        """(4, 4) the inverse of `X_BW`."""
        return np.asarray(np.linalg.inv(self.table.X_BW))

    def in_base(self, motion: ToolMotion) -> ToolMotion:
        """A task's motion over the table, converted to the arm's base frame."""
        return ToolMotion(motion.t_s, self.X_BW @ motion.X_BT, motion.contact)
