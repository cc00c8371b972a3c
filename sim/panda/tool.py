"""The hand with a task's tool, and the default workcell of a task."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import HAND, HAND_MASS, LEVEL, Capsule, Tool
from hw.kinematics import FLANGE
from hw.mass import Mass
from hw.types import Array
from hw.workcell import STOPS_AT_N, STOPS_AT_NM, Workcell, arm_model


class Held(Protocol):
    """The tool of a task in the hand."""

    @property
    def X_FT(self) -> Array:
        """(4, 4) the tool in the flange."""
        ...

    @property
    def tool_mass(self) -> Mass:
        """Mass in the tool frame, without the hand."""
        ...

    @property
    def keep_clear(self) -> tuple[Capsule, ...]:
        """Capsules that must stay clear, in the tool frame."""
        ...


def held(
    X_FT: Array,
    mass_T: Mass,
    capsules_T: tuple[Capsule, ...] = (),
    points_T_m: ArrayLike = ((0.0, 0.0, 0.0),),
    name: str = "tool",
) -> Tool:
    """The hand with a tool at X_FT (4, 4), which has the mass `mass_T` in the tool frame.

    `capsules_T`, in the tool frame, must stay clear of arm, table and boxes; the points `points_T_m` (P, 3), in the
    tool frame too, may touch the table.
    """

    def in_flange(p_T_m: ArrayLike) -> Array:
        return np.asarray(np.asarray(p_T_m, dtype=np.float64) @ X_FT[:3, :3].T + X_FT[:3, 3])

    carried = (replace(c, link=FLANGE, start_m=in_flange(c.start_m), end_m=in_flange(c.end_m)) for c in capsules_T)
    mass = HAND_MASS + mass_T.placed(X_FT)
    return Tool(name, mass, (*HAND, *carried), in_flange(np.atleast_2d(points_T_m)))


def tool_of(hardware: Held) -> Tool:
    """The hand with the task's tool at `hardware.X_FT`."""
    return held(hardware.X_FT, hardware.tool_mass, hardware.keep_clear)


def cell_as_shipped(hardware: Held, model: str) -> Workcell:
    """The arm `model` with the task's tool over a level table at z = 0, nothing around it, its joints without error."""
    return Workcell(arm_model(model, np.zeros(7)), tool_of(hardware), LEVEL, (), STOPS_AT_N, np.array(STOPS_AT_NM))
