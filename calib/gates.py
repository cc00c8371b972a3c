"""The gates that decide whether a calibration is good enough to use, each with value, limit and advice."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.checks import joint_offsets, square_size, variety
from calib.closed_form import disagreement_mm
from calib.types import Check, Grade, Setup, Solution

MIN_USED = 10
MAX_REJECTED_SHARE = 0.30
FIT_LIMIT_PX = 0.8
HELD_OUT_LIMIT_PX = 1.0
WORST_LIMIT_MM = 5.0
NEAR_M = 0.3
CROSS_CHECK_LIMIT_MM = 15.0
"""The closed forms differ by more than this only if all data are wrong."""


def gates_of(solution: Solution, setup: Setup, checks: Sequence[Check] = ()) -> tuple[Check, ...]:
    """Apply all gates. `checks` are further measurements besides the solution; a bad one also forbids."""
    own = (square_size(solution), joint_offsets(solution), variety(solution))
    named = {check.name for check in checks}
    figures = of_camera(
        solution,
        setup,
        fit_px=solution.fit_px,
        held_out_px=solution.held_out_px,
        worst_95_mm=solution.uncertainty.worst_95_mm,
    )
    closed = _closed_forms(disagreement_mm(solution.methods))
    return (*figures, closed, *(check for check in own if check.name not in named), *checks)


def of_camera(
    alone: Solution, setup: Setup, *, fit_px: float, held_out_px: float, worst_95_mm: float
) -> tuple[Check, ...]:
    """The gates of one camera, from the figures of its solution, alone or together with other cameras. The choice of
    views is that of `alone`.
    """
    rejected = 100 * (1 - len(alone.used) / len(alone.views))
    intrinsics = _why_fit_is_bad(alone, setup)
    unseen = "held-out views are predicted badly: add views, tilted to all sides"
    where = "95 % at the worst corner of the work volume: add views there, and more tilted ones"
    return (
        _at_least("views used", len(alone.used), MIN_USED, "", "record more views"),
        _at_most("views rejected", rejected, 100 * MAX_REJECTED_SHARE, "%", _why_rejected(alone)),
        _at_most("fit", fit_px, FIT_LIMIT_PX, "px", intrinsics),
        _at_most("held-out error", held_out_px, HELD_OUT_LIMIT_PX, "px", unseen),
        _at_most("stated error", worst_95_mm, WORST_LIMIT_MM, "mm", where),
    )


NOISY_RAD = 5e-4
"""The joints of a working arm repeat to a fifth of this. Above it, the arm spoils the fit, and not the lens."""


def _why_fit_is_bad(alone: Solution, setup: Setup) -> str:
    """The advice about a bad fit, by the largest error that the views show."""
    noise = alone.noise
    if np.isfinite(noise.joint_rad) and noise.joint_rad > NOISY_RAD:
        return (
            f"the arm's joints are off by {1e3 * noise.joint_rad:.1f} mrad from view to view ({noise.flange_mm:.1f} mm "
            "at the board): let it rest before each picture, and check brakes, encoders and the time of the readings"
        )
    if alone.distance_m < NEAR_M:
        return (
            f"the board is {alone.distance_m:.2f} m from the camera, where errors of lens and print count most: hold "
            f"it at {NEAR_M:g} m or more, and give the pictures as the camera took them, unpainted and unscaled"
        )
    size = f"{setup.colour.width} x {setup.colour.height}"
    return f"check the intrinsics (for {size}), focus, light, and that the board is flat"


def _why_rejected(solution: Solution) -> str:
    """The advice about rejected views. If all of them are at one end of the series, something slipped."""
    used = [view.used for view in solution.views]
    changes = [i for i in range(1, len(used)) if used[i] != used[i - 1]]
    if len(changes) == 1:
        return f"something slipped between {solution.views[changes[0] - 1].name} and {solution.views[changes[0]].name}"
    return "the arm must rest before a picture, and board and camera must be tight"


def _at_least(name: str, value: float, limit: float, unit: str, advice: str) -> Check:
    message = f"{name}: {value:.3g} {unit}, at least {limit:.3g} {unit}".replace(" ,", ",").rstrip()
    return Check.graded(name, message, (value, limit, unit), f": {advice}", good=value >= limit, worse=Grade.BAD)


def _at_most(name: str, value: float, limit: float, unit: str, advice: str) -> Check:
    message = f"{name}: {value:.3g} {unit}, at most {limit:.3g} {unit}"
    return Check.graded(name, message, (value, limit, unit), f": {advice}", good=value <= limit, worse=Grade.BAD)


def _closed_forms(value: float) -> Check:
    """This raises a doubt and is not a gate, because closed forms are the weaker estimate."""
    limit = CROSS_CHECK_LIMIT_MM
    message = f"closed forms: median {value:.1f} mm from the solution, at most {limit:.0f} mm"
    advice = ": look at the views' tilts and at the poses' units"
    return Check.graded("closed forms", message, (value, limit, "mm"), advice, good=value <= limit, worse=Grade.SUSPECT)
