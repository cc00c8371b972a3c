"""Computes the correction and its uncertainty from the set-downs.

The middle of the edge, where the tool is assumed to be, gives the table's plane (three numbers). Both corners of every
set-down then give the tool's height, forward shift, pitch and roll on that table (four numbers).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hw.collision import Table
from hw.kinematics import forward
from hw.records import Record
from hw.types import Array
from sim.panda.tool import Feeler, ToolCorrection

TOGETHER = 2
"""The corners of a set-down share an error: they count as one touch in every interval."""
FLOOR_M = 0.00005
"""No touch counts as more precise than this, however well a few of them agree."""
COVERAGE = 0.95
MISFIT_M = 0.0010
"""If a place deviates by more from all others, an object lies there, or something gives way."""
UNCERTAIN_M, UNCERTAIN_RAD = 0.0015, 0.035
"""Largest acceptable half widths of the intervals. A pitch that is off by 2° hardly changes what a scoop earns."""
MOST_PITCH_RAD, MOST_ROLL_RAD, MOST_HEIGHT_M = 0.075, 0.05, 0.015
"""Limits of the deviations: beyond them another corner would have touched, or the tool is a different one."""


@dataclass(frozen=True, eq=False)
class Touched:
    """One corner, or the middle of the edge, on the table: its place, and the true joints at rest."""

    name: str
    feeler: Feeler
    q_rad: Array  # (7,)


class MeasuredValue(Record):
    """A value and the half width of its 95 % interval."""

    value: float
    within: float


class Result(Record):
    """The result of a touch-off, in the fields of its file."""

    table_height_m: MeasuredValue  # of the table top under the work area, over z = 0 of the base
    tilt_x: MeasuredValue
    tilt_y: MeasuredValue
    table_origin_m: float  # height of the table's plane at the base's axis
    tool_height_m: MeasuredValue  # along its own Z
    tool_forward_m: MeasuredValue
    tool_pitch_rad: MeasuredValue
    tool_roll_rad: MeasuredValue
    edge_over_table_m: float  # half width of the 95 % interval of the edge's height over the table
    edge_too_high_m: float  # the edge is higher over the table than assumed by at most this, in 95 % of touch-offs
    misfit_m: float  # largest residual of a place


def table_of(touches: Sequence[Touched]) -> tuple[Table, Array, Array]:
    """The plane through the lowest points of the edge -> (table, residuals (N,) in m, normal matrix (3, 3))."""
    tips = np.array([_lowest(forward(t.q_rad), t.feeler) for t in touches])
    A = np.column_stack([np.ones(len(tips)), tips[:, :2]])
    plane, *_ = np.linalg.lstsq(A, tips[:, 2], rcond=None)
    return Table(*(float(v) for v in plane)), np.asarray(tips[:, 2] - A @ plane), A.T @ A


def tool_of(touches: Sequence[Touched], designed: Array, table: Table) -> tuple[ToolCorrection, Array, Array]:
    """The tool's pose -> (correction, residuals (N,) in m, normal matrix (4, 4): height, forward, pitch, roll)."""
    from scipy.optimize import least_squares

    X_BF = forward(np.array([t.q_rad for t in touches]))

    def correction(x: Array) -> ToolCorrection:
        return ToolCorrection(table, *(float(v) for v in x))

    def above(x: Array) -> Array:
        X_FT = correction(x).X_FT(designed)
        lowest = np.array([_lowest(X @ X_FT, t.feeler) for X, t in zip(X_BF, touches, strict=True)])
        return np.asarray(lowest[:, 2] - table.height_at(lowest))

    fit = least_squares(above, np.zeros(4), x_scale=[1e-3, 1e-3, 1e-2, 1e-2])
    return correction(fit.x), np.asarray(fit.fun), np.asarray(fit.jac.T @ fit.jac)


def solve(
    edge: Sequence[Touched], tool: Sequence[Touched], designed: Array, work_m: Array
) -> tuple[Result, tuple[str, ...]]:
    """The result from all touches, and the reasons against its use. `work_m` (2,) is the place for which the table's
    height is stated.

    Needs touches at three places for the table and with both ends of the tool at two pitches; raises ValueError.
    """
    if len({t.name for t in edge}) < 3 or len({t.name for t in tool}) < 4:
        raise ValueError("a touch-off needs the edge at 3 places, and the tool held in 4 ways, at least")
    table, table_off, table_N = table_of(edge)
    correction, tool_off, tool_N = tool_of(tool, designed, table)
    table_cov = _covariance(table_off, table_N)
    tool_cov = _covariance(tool_off, tool_N / TOGETHER)
    tool_free = (len(tool_off) - 4) // TOGETHER
    at = np.array([1.0, *work_m])
    table_var = float(at @ table_cov @ at)
    wide = [_quantile(len(table_off) - 3), _quantile(tool_free)]
    sigma = np.sqrt(np.diag(tool_cov))
    tilt = np.sqrt(np.diag(table_cov))

    def measured_value(value: float, half_width: float) -> MeasuredValue:
        return MeasuredValue(value=value, within=half_width)

    result = Result(
        table_height_m=measured_value(float(table.height_at(np.asarray(work_m))), wide[0] * float(np.sqrt(table_var))),
        tilt_x=measured_value(table.slope_x, wide[0] * float(tilt[1])),
        tilt_y=measured_value(table.slope_y, wide[0] * float(tilt[2])),
        table_origin_m=table.height_m,
        tool_height_m=measured_value(
            correction.height_m, float(np.hypot(wide[1] * sigma[0], wide[0] * np.sqrt(table_var)))
        ),
        tool_forward_m=measured_value(correction.forward_m, wide[1] * float(sigma[1])),
        tool_pitch_rad=measured_value(correction.pitch_rad, wide[1] * float(sigma[2])),
        tool_roll_rad=measured_value(correction.roll_rad, wide[1] * float(sigma[3])),
        edge_over_table_m=wide[1] * float(sigma[0]),
        edge_too_high_m=_one_sided(tool_free) * float(sigma[0]),
        misfit_m=float(max(np.abs(table_off).max(), np.abs(tool_off).max())),
    )
    uncertain = _uncertain(result.edge_over_table_m, result.tool_pitch_rad.within)
    return result, (*_misfits(edge, table_off), *_misfits(tool, tool_off), *uncertain, *_implausible(correction))


def _lowest(X_BT: Array, feeler: Feeler) -> Array:
    """(3,) the lowest point of the feeler."""
    p_m: Array = X_BT[:3, :3] @ feeler.p_T_m + X_BT[:3, 3]
    return np.asarray(p_m - [0.0, 0.0, feeler.radius_m])


def _covariance(off_m: Array, normal: Array) -> Array:
    free = max(len(off_m) - len(normal), 1)
    sigma_m = max(float(np.sqrt(np.sum(off_m**2) / free)), FLOOR_M)
    return np.asarray(sigma_m**2 * np.linalg.inv(normal))


def _quantile(free: int) -> float:
    from scipy.stats import t

    return float(t.ppf(0.5 + COVERAGE / 2.0, max(free, 1)))


def _one_sided(free: int) -> float:
    from scipy.stats import t

    return float(t.ppf(COVERAGE, max(free, 1)))


def _misfits(touches: Sequence[Touched], off_m: Array) -> tuple[str, ...]:
    worst = int(np.argmax(np.abs(off_m)))
    if abs(off_m[worst]) <= MISFIT_M:
        return ()
    return (
        f"{touches[worst].name} lies {1e3 * off_m[worst]:+.1f} mm off the plane of the other places (at most "
        f"{1e3 * MISFIT_M:.1f}): check that nothing lies there and that the tool is tight",
    )


def _uncertain(edge_m: float, pitch_rad: float) -> tuple[str, ...]:
    if edge_m <= UNCERTAIN_M and pitch_rad <= UNCERTAIN_RAD:
        return ()
    return (
        f"the edge's height over the table is known to {1e3 * edge_m:.1f} mm and the tool's pitch to "
        f"{np.rad2deg(pitch_rad):.1f}° only (at most {1e3 * UNCERTAIN_M:.1f} mm and {np.rad2deg(UNCERTAIN_RAD):.1f}°): "
        "check that the tool is held firmly and that the base is steady",
    )


def _implausible(correction: ToolCorrection) -> tuple[str, ...]:
    limits = (
        ("pitch", np.rad2deg(correction.pitch_rad), np.rad2deg(MOST_PITCH_RAD), "°"),
        ("roll", np.rad2deg(correction.roll_rad), np.rad2deg(MOST_ROLL_RAD), "°"),
        ("height", 1e3 * correction.height_m, 1e3 * MOST_HEIGHT_M, " mm"),
        ("place along the blade", 1e3 * correction.forward_m, 1e3 * MOST_HEIGHT_M, " mm"),
    )
    return tuple(
        f"the tool's {what} would be {value:+.1f}{unit} off its design (at most {most:.1f}{unit}): check that it is "
        "this task's tool, held as in its drawing"
        for what, value, most, unit in limits
        if abs(value) > most
    )
