"""Whether the piece lies on the table once the arm is home: then it fell off the tool on the way."""

from __future__ import annotations

import cv2
import numpy as np

from hw.types import Array, CameraModel, Frame
from perception.geometry import Area, on_plane, view_of
from perception.piece.chroma import matte
from perception.piece.detection import HEIGHT_M, PieceDetection

_BACK_M, _FORTH_M, _SIDE_M = 0.25, 0.50, 0.30  # search area around the piece's first place: as far as it may roll
_LEAST, _MOST = 0.25, 3.0  # of its earlier area in pixels
_NEW = 0.5
_RIM_PX = 5


def lies_at(before: Frame, after: Frame, model: CameraModel, X_BC: Array, detection: PieceDetection) -> Array | None:
    """(2,) place on the table, in m, of a new spot with the piece's colour and size; None: no such spot.

    `before` and `after` show the table with the arm at home, `X_BC` (4, 4) is the colour camera in the base frame.
    """
    x, y = detection.xy_m
    area: Area = (x - _BACK_M, x + _FORTH_M, y - _SIDE_M, y + _SIDE_M)
    view = view_of(model.colour, X_BC, area, HEIGHT_M)
    was, now = (
        matte(frame.colour[view.rows, view.columns], detection.piece_chroma, (detection.table_chroma,))
        for frame in (before, after)
    )
    corner = np.array([view.columns.start, view.rows.start])
    place = np.rint(detection.contour_px - corner).astype(np.int32)
    cv2.fillPoly(was, [place], 0.0)  # the piece left its first place, so a spot there now has come back
    cv2.polylines(was, [place], isClosed=True, color=0.0, thickness=_RIM_PX)
    count, _, stats, centroids = cv2.connectedComponentsWithStats((now - was > _NEW).astype(np.uint8), connectivity=8)
    if count < 2:
        return None
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    size = stats[largest, cv2.CC_STAT_AREA] / cv2.contourArea(detection.contour_px.astype(np.float32))
    if not _LEAST <= size <= _MOST:
        return None
    u, v = np.rint(centroids[largest]).astype(int)
    ray = np.array([[*(view.xy[v, u].astype(np.float64) / view.focal_px), 1.0]])
    return np.asarray(on_plane(ray, view.X_BV, detection.centre_m[2])[0])
