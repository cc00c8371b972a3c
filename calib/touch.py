"""Compares a corner of a still board as seen by the camera with the same corner touched by the arm's tip.

The tip's length need not be known. Touching the same corner from several directions gives it, together with the corner
(R_i t + p_i = c for all i, linear in the tip t and the corner c: the pivot calibration of tracked pointers); the
residuals say how precise the touches were.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.types import Check, Grade, Setup, Solution
from hw.types import Array, frozen_array
from perception.board import locate
from perception.board.types import Corners

NAME = "touched point"
MIN_TOUCHES = 4
LIMIT_MM = 3.0  # and three times the stated error there
LEAST_SCATTER_M = 3e-4
"""A touch guided by hand is not more precise than this, however well a few touches agree."""
LIMIT_SCATTER_M = 2e-3
LIMIT_SIGMA_M = 1.5e-3
"""Above this the tip was tilted too little to separate the corner from the tip's length."""


@dataclass(frozen=True, eq=False)
class Pivot:
    """The result of several touches of one point."""

    p_FT_m: Array  # (3,) the tip in the flange
    p_AT_m: Array  # (3,) the point
    scatter_m: float  # root mean square residual per axis, for the remaining degrees of freedom
    sigma_m: float  # one standard deviation of the point, all three axes together

    def __post_init__(self) -> None:
        for name in ("p_FT_m", "p_AT_m"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (3,), name))


def pivot(X_AF: Array) -> Pivot:
    """Tip and point from flange poses (N, 4, 4), N >= 4. `sigma_m` is inf if their tilts do not differ."""
    n = len(X_AF)
    if n < MIN_TOUCHES:
        raise ValueError(f"{n} touches, but at least {MIN_TOUCHES} are needed")
    A = np.concatenate([X_AF[:, :3, :3], np.broadcast_to(-np.eye(3), (n, 3, 3))], axis=2).reshape(-1, 6)
    b = -X_AF[:, :3, 3].reshape(-1)
    x, _, rank, _ = np.linalg.lstsq(A, b, rcond=1e-9)
    scatter_m = float(np.sqrt(np.sum((A @ x - b) ** 2) / (3 * n - 6)))
    if rank < 6:
        return Pivot(x[:3], x[3:], scatter_m, float("inf"))
    spread = np.linalg.inv(A.T @ A)[3:, 3:]
    return Pivot(x[:3], x[3:], scatter_m, float(max(scatter_m, LEAST_SCATTER_M) * np.sqrt(np.trace(spread))))


def check(solution: Solution, setup: Setup, corners: Corners, corner: int, X_AF: Array) -> Check:
    """`corners` are the corners of the lying board, `X_AF` (N, 4, 4) the flange at each touch of inner `corner`.

    The camera must be fixed. A bad verdict forbids the calibration; inconclusive touches are "not measured". Raises
    BoardNotFound if `corners` are too few for a pose.
    """
    if len(X_AF) < MIN_TOUCHES:
        return Check.unmeasured(NAME, f"{len(X_AF)} touches, {MIN_TOUCHES} from different directions are needed")
    touched = pivot(X_AF)
    if touched.scatter_m > LIMIT_SCATTER_M:
        return Check.unmeasured(
            NAME,
            f"the touches disagree by {1e3 * touched.scatter_m:.1f} mm (limit {1e3 * LIMIT_SCATTER_M:.0f} mm): the tip"
            " or the board moved; remove touch.json and touch again",
        )
    if touched.sigma_m > LIMIT_SIGMA_M:
        return Check.unmeasured(
            NAME, "the tip leaned too little between the touches: lean it by 20 to 40° to four sides"
        )
    pose = locate(corners, setup.board, setup.colour)
    if pose.ambiguous:
        return Check.unmeasured(
            NAME, "the board lies too far away or too square to the camera for its tilt to be measured; lay it nearer"
        )
    p_M = setup.board.p_MK_m[corner]
    p_A_m = solution.X_AC @ pose.X_VM @ np.array([*p_M, 1.0])
    stated_mm = solution.uncertainty.arm_worst_95_mm / 2
    value = float(1e3 * np.linalg.norm(p_A_m[:3] - touched.p_AT_m))
    limit = float(np.hypot(LIMIT_MM, 3.0 * float(np.hypot(stated_mm, 1e3 * touched.sigma_m))))
    good, length_mm = value <= limit, 1e3 * float(np.linalg.norm(touched.p_FT_m))
    message = f"the touched point is {value:.1f} mm from where the camera sees it (limit {limit:.1f} mm)"
    if not good:
        message += (
            ": touch it again with the calibrated tip; if the distance stays, check the tool's length and recalibrate"
        )
    message += (
        f"; {len(X_AF)} touches agree to {1e3 * touched.scatter_m:.1f} mm, the tip {length_mm:.0f} mm from the flange"
    )
    return Check.graded(NAME, message, (value, limit, "mm"), "", good=good, worse=Grade.BAD)
