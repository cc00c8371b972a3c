"""Searches a whole frame for a piece that was lost: it fell, rolled away, or came out from behind the tool."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from hw.types import Array, Frame
from perception.geometry import View, on_plane, transform
from perception.piece.chroma import matte
from perception.piece.proxy import Proxy, coverage

_SAME_COLOUR = 0.5
_LEAST, _MOST = 0.4, 2.0  # of the area that the piece covers there
_READINGS = 8  # of depth, at least, for a place above the table
_CANDIDATES = 3


def places(view: View, depth_view: View, frame: Frame, proxy: Proxy, chroma: tuple[Array, ...]) -> Iterator[Array]:
    """(3,) m in the base frame: places of spots with the piece's colour and size, the largest spot first.

    `chroma` are the chromaticities (2,) of the piece and of everything around it. The height comes from the depth
    camera; without enough readings the piece lies on the table.
    """
    share = matte(frame.colour[view.rows, view.columns], chroma[0], chroma[1:])
    count, labels, stats, centroids = cv2.connectedComponentsWithStats((share > _SAME_COLOUR).astype(np.uint8))
    points_m = _readings(depth_view, frame)
    labelled = view.sample(labels.astype(np.float32), points_m)
    by_area = sorted(range(1, count), key=lambda i: -stats[i, cv2.CC_STAT_AREA])
    for i in by_area[:_CANDIDATES]:
        u, v = np.rint(centroids[i]).astype(int)
        ray = np.array([*(view.xy[v, u].astype(np.float64) / view.focal_px), 1.0])
        centre_m = _on_ray(ray, view, points_m[labelled == i], proxy)
        X_BO = np.eye(4)
        X_BO[:3, 3] = centre_m
        _, cover, _ = coverage(proxy.outline(X_BO, view), view.xy.reshape(-1, 2))
        if _LEAST * cover.sum() <= share[labels == i].sum() <= _MOST * cover.sum():
            yield centre_m


def _readings(depth_view: View, frame: Frame) -> Array:
    """(n, 3) m, all readings of depth in the base frame."""
    depth_m = frame.depth_mm[depth_view.rows, depth_view.columns].reshape(-1) / 1000.0
    read = depth_m > 0
    return transform(depth_view.X_BV, depth_view.directions[read] * depth_m[read, None])


def _on_ray(ray: Array, view: View, front_m: Array, proxy: Proxy) -> Array:
    """(3,) the centre on a ray of the camera, half a piece behind its readings (n, 3)."""
    lowest_m = float(min(proxy.half_m))
    height_m = lowest_m if len(front_m) < _READINGS else max(lowest_m, float(np.median(front_m[:, 2])) - lowest_m / 2)
    return np.array([*on_plane(ray[None], view.X_BV, height_m)[0], height_m])
