"""The key frames of a trial for the report: start, contact, lift, end, rest."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from adaptsim_cli.session.recording import encode_jpeg
from adaptsim_cli.session.records import KeyMoment
from adaptsim_cli.session.target import Image
from hw.types import Array, CameraModel, ContactWindow, Frame
from perception.types import ObjectTrack

_HEIGHT_PX = 480
_ASPECT = 1.0
_REACH_M, _FALLEN_REACH_M = 0.08, 0.20  # margin shown around the object's path; larger for a fallen one, which rolls
_REST_S = 0.15  # an object tracked this much longer than the motion came to rest elsewhere
_QUALITY = 85
_RING_PX = 11


def moments(duration_s: float, contact: ContactWindow | None, last_s: float) -> tuple[tuple[str, float], ...]:
    """(label, seconds since the start of the motion), in order; the object is tracked until `last_s`."""
    rest = (("rest", last_s),) if last_s > duration_s + _REST_S else ()
    if contact is None:
        return (("start", 0.0), ("middle", duration_s / 2), ("end", duration_s), *rest)
    touching_s = (contact.start_s + contact.end_s) / 2  # the first touch is often the start itself
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
    track: ObjectTrack | None = None,
) -> tuple[tuple[KeyMoment, ...], dict[str, bytes]]:
    """The frames nearest to the `wanted` moments, cut around the points `seen_m` (N, 3) -> (records, name -> JPEG).

    An object that has `fallen` gets a wider cut, because it rolls. A ring marks the centre of the `track` at that time,
    a line its path until then.
    """
    if not frames:
        return (), {}
    times_s = np.array([frame.t_s for frame in frames]) - t_start_s
    window = _window(model, X_BC, seen_m, _FALLEN_REACH_M if fallen else _REACH_M)
    kept, files = [], {}
    for label, t_s in wanted:
        index = int(np.abs(times_s - t_s).argmin())
        name = f"moment-{label}.jpg"
        picture = _cut(frames[index].colour, window)
        if track is not None:
            _mark(picture, _way_px(model, X_BC, track, float(times_s[index])), window)
        files[name] = encode_jpeg(picture, _QUALITY)
        kept.append(KeyMoment(label=label, t_s=float(times_s[index]), file=name))
    return tuple(kept), files


def _window(model: CameraModel, X_BC: Array, seen_m: Array, reach_m: float) -> tuple[int, int, int, int]:
    """(left, top, right, bottom) in pixels of the colour image, inside it, with aspect _ASPECT."""
    colour = model.colour
    low_m, high_m = seen_m.min(axis=0) - reach_m, seen_m.max(axis=0) + reach_m
    top_m = seen_m[:, 2].max() + seen_m[1:, 2].min()  # the highest centre and half the object's own height
    corners = np.array([[x, y, z] for x in (low_m[0], high_m[0]) for y in (low_m[1], high_m[1]) for z in (0.0, top_m)])
    pixels = _pixels(model, X_BC, corners)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    middle = (low + high) / 2
    height = min(max(high[1] - low[1], (high[0] - low[0]) / _ASPECT), colour.height, colour.width / _ASPECT)
    half = np.array([height * _ASPECT, height]) / 2
    limit = np.array([colour.width, colour.height])
    middle = np.clip(middle, half, limit - half)
    left, top = np.floor(middle - half).astype(int)
    right, bottom = np.ceil(middle + half).astype(int)
    return max(left, 0), max(top, 0), min(right, colour.width), min(bottom, colour.height)


def _pixels(model: CameraModel, X_BC: Array, p_m: Array) -> Array:
    """(N, 3) in the base frame -> (N, 2) in the colour image."""
    X_CB, colour = np.linalg.inv(X_BC), model.colour
    pixels, _ = cv2.projectPoints(
        p_m @ X_CB[:3, :3].T + X_CB[:3, 3], np.zeros(3), np.zeros(3), colour.K, colour.distortion
    )
    return np.asarray(pixels.reshape(-1, 2), np.float64)


def _way_px(model: CameraModel, X_BC: Array, track: ObjectTrack, until_s: float) -> Array:
    """(N, 2) the centre in the colour image at every tracked time up to `until_s`, and at that time."""
    before = track.state[track.t_s < until_s, :3]
    return _pixels(model, X_BC, np.concatenate([before, track.at(np.array([until_s]))[:, :3]]))


def _mark(picture: Image, way_px: Array, window: tuple[int, int, int, int]) -> None:
    """Draw the path of the centre, and a ring around its end, into a cut picture."""
    left, top, right, bottom = window
    scale = np.array([picture.shape[1] / (right - left), picture.shape[0] / (bottom - top)])
    shift = 4  # OpenCV draws in sixteenths of a pixel
    points = np.round((way_px - [left, top]) * scale * 2**shift).astype(np.int32)
    for colour, width in (((20, 20, 20), 4), ((255, 190, 40), 2)):
        cv2.polylines(picture, [points.reshape(-1, 1, 2)], False, colour, width - 1, cv2.LINE_AA, shift)
        centre = (int(points[-1, 0]), int(points[-1, 1]))
        cv2.circle(picture, centre, _RING_PX << shift, colour, width, cv2.LINE_AA, shift)


def _cut(image: Image, window: tuple[int, int, int, int]) -> Image:
    left, top, right, bottom = window
    size = (round(_HEIGHT_PX * _ASPECT), _HEIGHT_PX)
    return np.array(cv2.resize(image[top:bottom, left:right], size, interpolation=cv2.INTER_AREA), np.uint8)
