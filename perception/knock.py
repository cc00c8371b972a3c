"""Detects a camera that was knocked during a trial: then the whole picture moves at once, not only things in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.types import Frame
from perception.geometry import Array32
from perception.types import ObjectTrack

Grey = NDArray[np.uint8]

_WIDTH_PX = 320
_CELL_PX, _CLEAREST = 16, 0.003
"""One point is followed in each square cell, so that the arm with its many corners counts by its area; its least corner
strength is the second number, as a share of the strongest one.
"""
_RETURNS_PX, _POINTS = 0.3, 12
"""A point counts if it comes back this near when it is followed backwards; least number of points that count."""
_STILL_PX, _STILL, _MOVED = 0.5, 0.1, 0.004
"""A knock leaves at most a share of the points within a distance of their places, and moves half of them by at least
the last share of the picture's width: 5 px of 1280.
"""
_FRAMES = 3
"""Number of frames in a row that must show it, so that a single blurred one does not count."""
HAND = "a hand or another object"
"""The beginnings of the flags that a knock explains as well."""


def with_knock(track: ObjectTrack, frames: Sequence[Frame], t_start_s: float) -> ObjectTrack:
    """The track; if the camera was knocked, with a flag that says so instead of those about a hand in the picture."""
    first_s, last_s = track.t_s[0] + t_start_s, track.t_s[-1] + t_start_s
    shown = [frame for frame in frames if first_s - 1e-6 <= frame.t_s <= last_s + 1e-6]
    if len(shown) < _FRAMES + 1:
        return track
    start = _small(shown[0])
    points = _points(start)
    shifts = np.array([_shift_share(start, points, _small(frame)) for frame in shown])
    moved = np.convolve(shifts > 0.0, np.ones(_FRAMES), mode="valid") == _FRAMES
    if not moved.any():
        return track
    i = int(moved.argmax())
    width_px = shown[0].colour.shape[1]
    flag = (
        f"outcome uncertain: the whole picture moved by {width_px * float(np.median(shifts[i:])):.0f} px from "
        f"{shown[i].t_s - t_start_s:.2f} s on, so the camera was knocked: fix it, calibrate it, and redo the trial"
    )
    return replace(track, flags=(flag, *(other for other in track.flags if not other.startswith(HAND))))


def _small(frame: Frame) -> Grey:
    """A small grey picture with even contrast."""
    height, width = frame.colour.shape[:2]
    size = (_WIDTH_PX, round(_WIDTH_PX * height / width))
    grey = cv2.cvtColor(cv2.resize(frame.colour, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    return np.asarray(cv2.createCLAHE(2.0, (8, 8)).apply(grey), dtype=np.uint8)


def _points(picture: Grey) -> Array32:
    """(N, 1, 2) the clearest corner in each cell of the picture, in px."""
    strength = cv2.cornerMinEigenVal(picture, 5)
    rows, columns = (size // _CELL_PX for size in picture.shape)
    cells = strength[: rows * _CELL_PX, : columns * _CELL_PX].reshape(rows, _CELL_PX, columns, _CELL_PX)
    cells = cells.transpose(0, 2, 1, 3).reshape(rows, columns, -1)
    clear = np.argwhere(cells.max(axis=-1) > _CLEAREST * strength.max())
    within = np.column_stack(np.divmod(cells[*clear.T].argmax(axis=-1), _CELL_PX))
    return np.asarray((clear * _CELL_PX + within)[:, None, ::-1], dtype=np.float32)


def _shift_share(start: Grey, points: Array32, now: Grey) -> float:
    """How far the whole picture has moved, as a share of its width; 0 if a part of it stands still."""
    if len(points) < _POINTS:
        return 0.0
    moved, forward, _ = cv2.calcOpticalFlowPyrLK(start, now, points, points.copy(), winSize=(15, 15), maxLevel=2)
    back, backward, _ = cv2.calcOpticalFlowPyrLK(now, start, moved, moved.copy(), winSize=(15, 15), maxLevel=2)
    followed = (forward[:, 0] == 1) & (backward[:, 0] == 1)
    followed &= np.linalg.norm((back - points)[:, 0], axis=1) < _RETURNS_PX
    way_px = np.linalg.norm((moved - points)[followed, 0], axis=1)
    if followed.sum() < _POINTS or (way_px < _STILL_PX).mean() > _STILL:
        return 0.0
    share = float(np.median(way_px)) / start.shape[1]
    return share if share > _MOVED else 0.0
