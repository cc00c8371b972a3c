"""Workcells for tests: a level table with nothing around, joints without error, unless a test says otherwise; and
motions of an arm in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import BARE_HAND, LEVEL, KeepOut, Table, Tool
from hw.limits import Worst
from hw.mass import NOTHING
from hw.types import Array, ContactWindow, JointPath
from hw.workcell import STOPS_AT_N, STOPS_AT_NM, Workcell, arm_model

READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])


def smooth(u: Array) -> Array:
    """The seventh-order step from 0 to 1: at rest at both ends, without acceleration or jerk."""
    return u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3)


def move(
    change_rad: ArrayLike, duration_s: float = 2.0, contact: ContactWindow | None = None, start_rad: Array = READY
) -> JointPath:
    """A seventh-order step by `change_rad` (7,), at rest at both ends."""
    t_s = np.arange(round(duration_s * 1000) + 1) / 1000
    return JointPath(t_s, start_rad + smooth(t_s / t_s[-1])[:, None] * np.asarray(change_rad), contact)


def joint(number: int, change_rad: float) -> Array:
    """(7,) a change of one joint, counted from 1."""
    return np.asarray(change_rad * (np.arange(1, 8) == number))


def find(path: JointPath, quantity: str, within: Workcell) -> Worst:
    """The check of one quantity."""
    (found,) = (check for check in within.check(path).checks if check.quantity == quantity)
    return found


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
