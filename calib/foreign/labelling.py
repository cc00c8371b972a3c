"""Finds the orientation, in each picture, of targets that look the same when rotated (plain chessboards, circles).

Between two views, hand and target rotate by the same angle, wherever the camera is. So the labels of any two views can
be compared without a calibration, and each view takes the orientation that most others support.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.bundle import motion_of
from calib.condense import condense, unusable
from calib.geometry import rotation_vector
from calib.types import Forward, Setup, View
from hw.poses import inverse
from hw.types import Array
from perception.board.types import CalibrationTarget, Corners

_ROUNDS = 20


def resolve_symmetry(views: Sequence[View], setup: Setup, forward: Forward | None) -> tuple[View, ...]:
    """The views with consistent numbers of their points: those of the view that agrees with most others."""
    usable = [view for view in views if not unusable(view.corners, setup.board, setup.colour)]
    if not setup.board.turns or len(usable) < 3:
        return tuple(views)
    readings = [renumbered(view.corners, setup.board) for view in usable]
    numbered = [[one[k] for one in readings] for k in range(1 + len(setup.board.turns))]
    names = [view.name for view in usable]
    X_CM = np.stack([condense(names, corners, setup.board, setup.colour).X_CM[0] for corners in numbered])
    moved = motion_of(usable, setup.mounting, forward)
    side = _sides(moved.X_AH(np.zeros(moved.joints)), X_CM)
    chosen = {name: numbered[k][i] for i, (name, k) in enumerate(zip(names, side, strict=True))}
    return tuple(replace(view, corners=chosen.get(view.name, view.corners)) for view in views)


def renumbered(corners: Corners, board: CalibrationTarget) -> list[Corners]:
    """The corners as numbered, then as numbered from every other end from which the board looks the same."""
    labellings = [corners]
    for ids in board.turns:
        new = ids[corners.ids]
        order = np.argsort(new)
        labellings.append(Corners(new[order], corners.px[order]))
    return labellings


def _sides(X_AH: Array, X_CM: Array) -> list[int]:
    """Poses of the holder (N, 4, 4), and of the target under each labelling (S, N, 4, 4) -> the labelling of every
    view.
    """
    sides, n = X_CM.shape[:2]
    turned = _angles(X_AH[:, None], X_AH[None])
    misfit = np.stack(  # (S, S, N, N): labellings of the two views, then the two views
        [[np.abs(_angles(X_CM[a][:, None], X_CM[b][None]) - turned) for b in range(sides)] for a in range(sides)]
    )
    best: tuple[float, list[int]] = (np.inf, [0] * n)
    for first in range(n):
        side = np.argmin(misfit[0, :, first, :], axis=0)
        side[first] = 0
        for _ in range(_ROUNDS):
            # the median over the others, so that one wrong pose cannot outvote the rest
            cost = np.stack([np.median(misfit[a, side, :, np.arange(n)], axis=0) for a in range(sides)])
            again = np.argmin(cost, axis=0)
            if (again == side).all():
                break
            side = again
        total = float(np.median(misfit[side[:, None], side[None], np.arange(n)[:, None], np.arange(n)[None]]))
        if total < best[0] - 1e-9:
            best = total, side.tolist()
    return best[1]


def _angles(X_a: Array, X_b: Array) -> Array:
    step = inverse(np.broadcast_to(X_a, np.broadcast_shapes(X_a.shape, X_b.shape))) @ X_b
    return np.asarray(np.linalg.norm(rotation_vector(step[..., :3, :3]), axis=-1))
