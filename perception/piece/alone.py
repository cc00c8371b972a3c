"""Whether a piece is the only thing of its kind where tracking could follow it."""

from __future__ import annotations

import cv2
import numpy as np

from hw.types import Array, CameraModel, Frame
from perception.errors import ObjectNotFound
from perception.geometry import Area, on_plane, view_of
from perception.piece.detection import HEIGHT_M, PieceDetection, find_piece
from perception.piece.tracking import likeness

_BESIDE_M = (0.10, 0.30, 0.20)
"""How far from the piece another one is searched: backwards, forwards and sideways (m)."""
_LIKE = 0.7
_LEAST, _MOST = 0.25, 3.0  # of the piece's area in pixels


def find_alone(frame: Frame, model: CameraModel, X_BC: Array, area: Area) -> PieceDetection:
    """The same as `find_piece`, but also raises ObjectNotFound if a second such piece lies outside of `area` and within
    reach.
    """
    detection = find_piece(frame, model, X_BC, area)
    if (other_m := _another(frame, model, X_BC, detection)) is not None:
        raise ObjectNotFound(
            f"something of the piece's colour and size lies at ({other_m[0]:.3f}, {other_m[1]:+.3f}) m too, and could "
            "be followed in its place; take it away"
        )
    return detection


def _another(frame: Frame, model: CameraModel, X_BC: Array, detection: PieceDetection) -> Array | None:
    """(2,) place on the table (m) of another spot with the piece's colour and size; None: there is none."""
    (x, y), (back, forth, side) = detection.xy_m, _BESIDE_M
    view = view_of(model.colour, X_BC, (x - back, x + forth, y - side, y + side), HEIGHT_M)
    like = (likeness(frame.colour[view.rows, view.columns], detection) > _LIKE).astype(np.uint8)
    outline = np.rint(detection.contour_px - np.array([view.columns.start, view.rows.start])).astype(np.int32)
    cv2.fillPoly(like, [outline], 1)
    count, labels, stats, centroids = cv2.connectedComponentsWithStats(like, connectivity=8)
    own, (height, width) = labels[outline[0, 1], outline[0, 0]], like.shape
    for label in range(1, count):
        left, top, w, h, size = stats[label]
        touches = left == 0 or top == 0 or left + w == width or top + h == height
        share = size / cv2.contourArea(detection.contour_px.astype(np.float32))
        if label != own and not touches and _LEAST <= share <= _MOST:
            u, v = np.rint(centroids[label]).astype(int)
            ray = np.array([[*(view.xy[v, u].astype(np.float64) / view.focal_px), 1.0]])
            return np.asarray(on_plane(ray, view.X_BV, detection.centre_m[2])[0])
    return None
