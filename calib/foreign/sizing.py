"""Estimates the size of an unmeasured target from the arm's motion, which has a known scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.bundle import motion_of
from calib.closed_form import robust_start, size_by_motion
from calib.condense import condense, unusable
from calib.errors import UnusableViews
from calib.solve import MIN_VIEWS, solve
from calib.types import Forward, Mounting, Setup, Solution, View, corners_of_box
from hw.types import Array

_ROUNDS = 4
_ENOUGH = 2e-4


def solve_any_size(views: Sequence[View], setup: Setup, forward: Forward | None) -> tuple[Solution, Setup]:
    """The solution, and the setup with the estimated size if it was unknown. Raises UnusableViews or a subclass."""
    setup = roughly_sized(views, setup, forward)
    solution = solve(views, setup, forward)
    for _ in range(_ROUNDS):
        if setup.size_known or abs(solution.square_scale - 1.0) < _ENOUGH:
            break
        setup = _scaled(setup, solution.square_scale)
        solution = solve(views, setup, forward)
    return solution, setup


def roughly_sized(views: Sequence[View], setup: Setup, forward: Forward | None) -> Setup:
    """The setup with the size from a closed form, to a few per cent, if it was unknown."""
    if setup.size_known:
        return setup
    usable = [view for view in views if not unusable(view.corners, setup.board, setup.colour)]
    if len(usable) < MIN_VIEWS:
        return setup
    sight = condense([v.name for v in usable], [v.corners for v in usable], setup.board, setup.colour)
    moved = motion_of(usable, setup.mounting, forward)
    return _scaled(setup, size_by_motion(moved.X_AH(np.zeros(moved.joints)), sight.X_CM[0]))


def _scaled(setup: Setup, factor: float) -> Setup:
    return replace(setup, board=setup.board.scaled(factor))


_FEWEST = 4
_LEAST_M = 0.05
_SHARE = 10.0  # per cent of the views that may lie beyond each face: spoilt views do not stretch the box


def where_the_target_was(views: Sequence[View], setup: Setup, forward: Forward | None) -> Array | None:
    """(8, 3) corners, in A, of the box around the target's centres; None if too few views show it."""
    usable = [view for view in views if not unusable(view.corners, setup.board, setup.colour)]
    if len(usable) < _FEWEST:
        return None
    try:
        sized = roughly_sized(usable, setup, forward)
        moved = motion_of(usable, setup.mounting, forward)
    except UnusableViews:
        return None
    X_CM = condense([v.name for v in usable], [v.corners for v in usable], sized.board, sized.colour).X_CM[0]
    X_AH = moved.X_AH(np.zeros(moved.joints))
    X_AC, X_HM = robust_start(X_AH, X_CM)
    X_AM = X_AH @ X_HM if setup.mounting is Mounting.FIXED else X_AC @ X_CM
    centres = X_AM[:, :3, :3] @ sized.board.outline_m.mean(axis=0) + X_AM[:, :3, 3]
    low, high = np.percentile(centres, [_SHARE, 100 - _SHARE], axis=0)
    middle, half = (low + high) / 2, np.maximum(high - low, _LEAST_M) / 2
    return corners_of_box(np.stack([middle - half, middle + half], axis=1).tolist())
