"""What a touch-off found, as planning uses it: where the table is, and how the tool is truly held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from hw.collision import LEVEL, Table
from hw.types import Array
from sim.types import ToolMotion


@dataclass(frozen=True)
class ToolCorrection:
    """Nothing found yet: the default. All of the tool in its own frame T as designed, about the tool frame's origin."""

    table: Table = LEVEL
    height_m: float = 0.0  # along Z of T
    forward_m: float = 0.0  # along X of T
    pitch_rad: float = 0.0  # about Y of T; positive: edge down
    roll_rad: float = 0.0  # about X of T; positive: left side up

    def X_FT(self, designed: Array) -> Array:
        """(4, 4) the tool in the flange, given how it was `designed` to be held."""
        off = np.eye(4)
        off[:3, :3] = Rotation.from_euler("XY", [self.roll_rad, self.pitch_rad]).as_matrix()
        off[:3, 3] = self.forward_m, 0.0, self.height_m
        return np.asarray(designed @ off)

    @property
    def X_BW(self) -> Array:
        """(4, 4) the table's frame, in which tasks plan and cameras see, in the arm's base."""
        return self.table.X_BW

    @property
    def X_WB(self) -> Array:
        """(4, 4) the other way round."""
        return np.asarray(np.linalg.inv(self.table.X_BW))

    def in_base(self, motion: ToolMotion) -> ToolMotion:
        """A motion over the table, as a task plans it, in the frame in which the arm moves."""
        return ToolMotion(motion.t_s, self.X_BW @ motion.X_BT, motion.contact)
