"""How well the predicted outline of a moving body fits pictures of one fixed camera.

The median of the pictures is the room without the body; a picture differs from it where the body is. Along the true
outline the inner rim differs and the outer rim does not. The shift of the outline for which this holds best is the
error of the prediction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.types import Array, Intrinsics
from perception.geometry import scaled

FEWEST = 5
"""Fewest pictures that tell the room from the bodies moving in it."""
_WIDTH_PX = 640  # pictures are made this wide before they are compared
_RIM_PX, _SEARCH_PX, _BESIDE_PX = 4, 16, 9
_LEAST_RIM_PX = 150
_LEAST_CONTRAST = 0.15
_AGREE = 0.7
"""Share of the pictures' own best contrasts that one shift for all must reach.

It is 0.8 and more for a hand in full view, even of a camera that is believed elsewhere. It is under 0.65 for one that
shows only short edges beside a board and the rim of the picture: each picture then prefers another shift.
"""
_DIFFERENT = 20.0  # of CIELAB, lightness counted half: certainly not the room
_NEAREST_M = 0.15

Map = NDArray[np.float32]
Mask = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class OutlineView:
    """One picture, and the place where a body should be, as convex parts of points (n, 3) in the camera's frame."""

    colour: NDArray[np.uint8]  # (H, W, 3) RGB
    body: tuple[Array, ...]
    beside: tuple[Array, ...]  # parts that hide its outline, or continue it


@dataclass(frozen=True, eq=False)
class OutlineFit:
    """The offset of outlines, in pixels of the pictures."""

    shift_px: Array  # (2,) right and down: the common shift with the best fit
    off_px: float  # median over the pictures, each shifted by itself
    pictures: int  # in which the outline stands out from the room
    metres_per_px: float  # at the body

    @property
    def shift_m(self) -> float:
        """The shift in m across the line of sight, at the body."""
        return float(np.linalg.norm(self.shift_px)) * self.metres_per_px


def fit(views: Sequence[OutlineView], camera: Intrinsics) -> OutlineFit | None:
    """None if the outline stands out in too few pictures, or they do not agree on a shift."""
    if len(views) < FEWEST:
        return None
    scale = min(1.0, _WIDTH_PX / camera.width)
    small = scaled(camera, scale)
    maps, ranges_m = [], []
    for one, moved in zip(views, changes([s.colour for s in views], scale), strict=True):
        contrast = _map(one, moved, small)
        if contrast is not None and contrast.max() > _LEAST_CONTRAST:
            maps.append(contrast)
            ranges_m.append(float(np.concatenate(one.body)[:, 2].mean()))
    if len(maps) < FEWEST:
        return None
    off = [float(np.linalg.norm(_best(one))) for one in maps]
    mean = np.mean(maps, axis=0)
    if mean.max() < _AGREE * np.mean([one.max() for one in maps]):
        return None
    joint = _best(mean)
    at_m = float(np.median(ranges_m)) / float(camera.K[0, 0])
    return OutlineFit(joint / scale, float(np.median(off)) / scale, len(maps), at_m)


def changes(pictures: Sequence[NDArray[np.uint8]], scale: float = 1.0) -> list[Map]:
    """How much each picture (H, W, 3 RGB) differs from the median of all, 0 to 1, scaled by `scale`."""
    lab = [
        cv2.cvtColor(
            cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2LAB
        ).astype(np.int16)
        for picture in pictures
    ]
    room = np.median(np.stack(lab), axis=0)
    weights = np.array([0.5, 1.0, 1.0])
    return [
        np.clip(cv2.GaussianBlur(np.abs(one - room) @ weights, (0, 0), 1.0) / _DIFFERENT, 0.0, 1.0).astype(np.float32)
        for one in lab
    ]


def silhouette(parts: Sequence[Array], camera: Intrinsics) -> Mask | None:
    """(H, W) 1 where one of the convex parts is seen; None if a part is at or behind the camera."""
    mask = np.zeros((camera.height, camera.width), np.uint8)
    for part in parts:
        if part[:, 2].min() < _NEAREST_M:
            return None
        px, _ = cv2.projectPoints(part, np.zeros(3), np.zeros(3), camera.K, camera.distortion)
        hull = cv2.convexHull(np.clip(px, -1e4, 1e4).astype(np.float32))
        cv2.fillConvexPoly(mask, np.rint(16 * hull).astype(np.int32), 1, shift=4)
    return mask


def _map(one: OutlineView, moved: Map, camera: Intrinsics) -> Map | None:
    """(2 S + 1, 2 S + 1) contrast over the outline by its shift; None if too little of the outline is in view."""
    body, beside = silhouette(one.body, camera), silhouette(one.beside, camera)
    if body is None or beside is None:
        return None
    rim = np.ones((2 * _RIM_PX + 1, 2 * _RIM_PX + 1), np.uint8)
    free = cv2.dilate(beside, np.ones((2 * _BESIDE_PX + 1, 2 * _BESIDE_PX + 1), np.uint8)) == 0
    within = np.zeros_like(free)
    within[_SEARCH_PX:-_SEARCH_PX, _SEARCH_PX:-_SEARCH_PX] = True
    inner = (body > 0) & (cv2.erode(body, rim) == 0) & free & within
    outer = (body == 0) & (cv2.dilate(body, rim) > 0) & free & within
    if inner.sum() < _LEAST_RIM_PX or outer.sum() < _LEAST_RIM_PX:
        return None
    template = (inner / inner.sum() - outer / outer.sum()).astype(np.float32)
    core = template[_SEARCH_PX:-_SEARCH_PX, _SEARCH_PX:-_SEARCH_PX]
    return np.asarray(cv2.matchTemplate(moved, np.ascontiguousarray(core), cv2.TM_CCORR), dtype=np.float32)


def _best(contrast: Map) -> Array:
    """(2,) the shift, right and down, with the largest contrast."""
    v, u = np.unravel_index(int(contrast.argmax()), contrast.shape)
    return np.array([float(u - _SEARCH_PX), float(v - _SEARCH_PX)])
