"""Workcells for tests: a level table with nothing around, joints without error, unless a test says otherwise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import BARE_HAND, LEVEL, KeepOut, Table, Tool
from hw.mass import NOTHING
from hw.types import Array
from hw.workcell import STOPS_AT_N, STOPS_AT_NM, Workcell, arm_model


def cell(
    model: str = "panda",
    tool: Tool = BARE_HAND,
    *,
    table: Table = LEVEL,
    keep_out: tuple[KeepOut, ...] = (),
    stops_at_N: float = STOPS_AT_N,
    stops_at_Nm: ArrayLike = STOPS_AT_NM,
    zeros_rad: ArrayLike = (0.0,) * 7,
) -> Workcell:
    return Workcell(arm_model(model, zeros_rad), tool, table, keep_out, stops_at_N, np.asarray(stops_at_Nm))


def stick(tip_F_m: ArrayLike, name: str = "stick") -> Tool:
    """A tool of points (P, 3) in the flange that may touch the table, without a hand."""
    points: Array = np.atleast_2d(np.asarray(tip_F_m, dtype=np.float64))
    return Tool(name, NOTHING, (), points)
