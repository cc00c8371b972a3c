"""Detects a camera that was knocked during a trial: then the whole picture moves at once, not only things in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from hw.types import Frame
from perception.geometry import Array32
from perception.types import ObjectTrack

_WIDTH_PX = 320
_MOVED = 0.006
"""Share of the picture's width by which it moves at least: 8 px of 1280."""
_BETTER = 0.7
"""After they are moved back, the pictures must differ by less than this share of their first difference."""
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
    shifts = np.array([_shift_share(start, _small(frame)) for frame in shown])
    moved = np.convolve(shifts > _MOVED, np.ones(_FRAMES), mode="valid") == _FRAMES
    if not moved.any():
        return track
    i = int(moved.argmax())
    width_px = shown[0].colour.shape[1]
    flag = (
        f"outcome uncertain: the whole picture moved by {width_px * float(np.median(shifts[i:])):.0f} px from "
        f"{shown[i].t_s - t_start_s:.2f} s on, so the camera was knocked: fix it, calibrate it, and redo the trial"
    )
    return replace(track, flags=(flag, *(other for other in track.flags if not other.startswith(HAND))))


def _small(frame: Frame) -> Array32:
    """A small grey picture without its mean and slow changes of light."""
    height, width = frame.colour.shape[:2]
    size = (_WIDTH_PX, round(_WIDTH_PX * height / width))
    grey = cv2.cvtColor(cv2.resize(frame.colour, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    wide = grey.astype(np.float32)
    return np.asarray(wide - cv2.GaussianBlur(wide, (0, 0), 12.0), dtype=np.float32)


def _shift_share(start: Array32, now: Array32) -> float:
    """How far the whole picture has moved, as a share of its width; 0 if no shift explains the difference."""
    window = cv2.createHanningWindow((start.shape[1], start.shape[0]), cv2.CV_32F)
    (u, v), _ = cv2.phaseCorrelate(start.copy(), now.copy(), window)  # it writes into its arguments
    if not np.isfinite([u, v]).all() or np.hypot(u, v) > 0.2 * start.shape[1]:
        return 0.0
    move = np.array([[1.0, 0.0, -u], [0.0, 1.0, -v]])
    back = np.asarray(cv2.warpAffine(now, move, (start.shape[1], start.shape[0])), dtype=np.float32)
    rim = int(np.ceil(np.hypot(u, v))) + 1
    inner = np.s_[rim:-rim, rim:-rim]
    differs, differs_back = _difference(now[inner], start[inner]), _difference(back[inner], start[inner])
    return float(np.hypot(u, v)) / start.shape[1] if differs_back < _BETTER * differs else 0.0


def _difference(one: Array32, other: Array32) -> float:
    """The mean difference of two pictures."""
    return float(np.abs(one - other).mean())
