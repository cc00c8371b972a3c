"""The work volume of a folder that states none: the box in which its views show the target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.bundle import motion_of
from calib.closed_form import robust_start
from calib.condense import condense, unusable
from calib.errors import UnusableViews
from calib.foreign.sizing import roughly_sized
from calib.types import Forward, Mounting, Setup, View, corners_of_box
from hw.types import Array

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
