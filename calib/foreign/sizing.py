"""Estimates the size of an unmeasured target from the arm's motion, which has a known scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.bundle import motion_of
from calib.closed_form import size_by_motion
from calib.condense import condense, unusable
from calib.solve import MIN_VIEWS, solve
from calib.types import Forward, Setup, Solution, View

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
