"""The camera frames of a trial that a person wants to see again: start, contact, lift, end, rest."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from adaptsim_cli.session.recording import encode_jpeg
from adaptsim_cli.session.records import KeyMoment
from adaptsim_cli.session.rig import Image
from hw.types import Array, CameraModel, ContactWindow, Frame

_HEIGHT_PX = 320
_ASPECT = 1.0
_REACH_M, _FALLEN_REACH_M = 0.08, 0.20  # what is shown around the object's path; one that fell rolls away
_REST_S = 0.15  # an object that is tracked longer than the motion by this has come to rest elsewhere
_QUALITY = 85


def moments(duration_s: float, contact: ContactWindow | None, last_s: float) -> tuple[tuple[str, float], ...]:
    """(label, seconds since the start of the motion), in order; the object is tracked until `last_s`."""
    rest = (("rest", last_s),) if last_s > duration_s + _REST_S else ()
    if contact is None:
        return (("start", 0.0), ("middle", duration_s / 2), ("end", duration_s), *rest)
    touching_s = (contact.start_s + contact.end_s) / 2  # the first touch often is the start itself
    return (("start", 0.0), ("contact", touching_s), ("lift", contact.end_s), ("end", duration_s), *rest)


def key_frames(
    frames: Sequence[Frame],
    model: CameraModel,
    X_BC: Array,
    seen_m: Array,
    t_start_s: float,
    wanted: Sequence[tuple[str, float]],
    *,
    fallen: bool = False,
) -> tuple[tuple[KeyMoment, ...], dict[str, bytes]]:
    """The frames nearest to the `wanted` moments, cut around the points `seen_m` (N, 3) -> (records, name -> JPEG).

    Around an object that has `fallen` there is room to roll.
    """
    if not frames:
        return (), {}
    times_s = np.array([frame.t_s for frame in frames]) - t_start_s
    window = _window(model, X_BC, seen_m, _FALLEN_REACH_M if fallen else _REACH_M)
    kept, files = [], {}
    for label, t_s in wanted:
        index = int(np.abs(times_s - t_s).argmin())
        name = f"moment-{label}.jpg"
        files[name] = encode_jpeg(_cut(frames[index].colour, window), _QUALITY)
        kept.append(KeyMoment(label=label, t_s=float(times_s[index]), file=name))
    return tuple(kept), files


def _window(model: CameraModel, X_BC: Array, seen_m: Array, reach_m: float) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) in pixels of the colour image, of aspect _ASPECT, inside the image."""
    colour = model.colour
    low_m, high_m = seen_m.min(axis=0) - reach_m, seen_m.max(axis=0) + reach_m
    top_m = seen_m[:, 2].max() + seen_m[1:, 2].min()  # the highest centre and half the object's own height
    corners = np.array([[x, y, z] for x in (low_m[0], high_m[0]) for y in (low_m[1], high_m[1]) for z in (0.0, top_m)])
    X_CB = np.linalg.inv(X_BC)
    pixels, _ = cv2.projectPoints(
        corners @ X_CB[:3, :3].T + X_CB[:3, 3], np.zeros(3), np.zeros(3), colour.K, colour.distortion
    )
    low, high = pixels.reshape(-1, 2).min(axis=0), pixels.reshape(-1, 2).max(axis=0)
    middle = (low + high) / 2
    height = min(max(high[1] - low[1], (high[0] - low[0]) / _ASPECT), colour.height, colour.width / _ASPECT)
    half = np.array([height * _ASPECT, height]) / 2
    limit = np.array([colour.width, colour.height])
    middle = np.clip(middle, half, limit - half)
    left, top = np.floor(middle - half).astype(int)
    right, bottom = np.ceil(middle + half).astype(int)
    return max(left, 0), max(top, 0), min(right, colour.width), min(bottom, colour.height)


def _cut(image: Image, window: tuple[int, int, int, int]) -> Image:
    left, top, right, bottom = window
    size = (round(_HEIGHT_PX * _ASPECT), _HEIGHT_PX)
    return np.asarray(cv2.resize(image[top:bottom, left:right], size, interpolation=cv2.INTER_AREA), np.uint8)
