"""Pictures of a tracked recording: its key moments, and a film as one sheet of small pictures. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from adaptsim_cli.bench.rig import Image
from adaptsim_cli.session.folders import FILM
from adaptsim_cli.session.recording import encode_jpeg
from adaptsim_cli.session.records import Film, KeyMoment
from hw.poses import inverse
from hw.types import Array, CameraModel, ContactWindow, Frame
from perception.types import ObjectTrack, Outcome

COLUMNS, ROWS = 6, 4
"""Columns and rows of small pictures on a sheet, in the order of reading."""
MOST_BYTES = 220_000
"""The largest sheet: 300 kB as text on a page."""
_MOMENT_PX, _CELL_PX = 480, 240  # both are square
_REACH_M, _FALLEN_REACH_M = 0.08, 0.20  # margin shown around the object's path; larger for a fallen one, which rolls
_REST_S = 0.15  # an object tracked this much longer than the motion came to rest elsewhere
_GOAL_M = 0.03  # radius of the ring at the goal
_QUALITY = 85
_WAY_RGB, _GOAL_RGB, _DARK = (255, 190, 40), (255, 60, 60), (20, 20, 20)
_SHIFT = 4  # OpenCV draws in sixteenths of a pixel


def key_moments(duration_s: float, contact: ContactWindow | None, last_s: float) -> tuple[tuple[str, float], ...]:
    """(label, seconds since the start of the motion), in order; the object is tracked until `last_s`."""
    rest = (("rest", last_s),) if last_s > duration_s + _REST_S else ()
    if contact is None:
        return (("start", 0.0), ("middle", duration_s / 2), ("end", duration_s), *rest)
    touching_s = (contact.start_s + contact.end_s) / 2  # the first touch is often the start itself
    return (("start", 0.0), ("contact", touching_s), ("lift", contact.end_s), ("end", duration_s), *rest)


@dataclass(frozen=True, eq=False)
class Filmed:
    """The recording of a motion, with the object's track."""

    frames: Sequence[Frame]
    model: CameraModel
    X_BC: Array  # (4, 4)
    t_start_s: float  # arm clock at the start of the tool's motion
    track: ObjectTrack
    found_m: Array  # (2,) the object before the motion, in the base frame
    goal_m: Array | None  # (2,) where it should come to rest

    def moments(self, instants: Sequence[tuple[str, float]]) -> tuple[tuple[KeyMoment, ...], dict[str, bytes]]:
        """The frames nearest to the moments at `instants`, cut around the object's path -> (records, name -> JPEG)."""
        moments, files, window = [], dict[str, bytes](), self._window()
        for label, t_s in instants if self.frames else ():
            frame, name = self._nearest(t_s), f"moment-{label}.jpg"
            files[name] = encode_jpeg(self._picture(frame, window, _MOMENT_PX), _QUALITY)
            moments.append(KeyMoment(label=label, t_s=frame.t_s - self.t_start_s, file=name))
        return tuple(moments), files

    def sheet(self) -> tuple[Film | None, dict[str, bytes]]:
        """Small pictures at even times of the whole trial, with the goal in view -> (record, name -> JPEG)."""
        if not self.frames:
            return None, {}
        window, end_s = self._window(with_goal=True), float(self.track.t_s[-1])
        cells = []
        for t_s in np.linspace(0.0, end_s, COLUMNS * ROWS):
            cells.append(self._picture(self._nearest(float(t_s)), window, _CELL_PX))
            write(cells[-1], f"{t_s:.2f} s", (6, 16), 0.4)
        rows = [np.hstack(cells[i : i + COLUMNS]) for i in range(0, len(cells), COLUMNS)]
        sheet = np.vstack(rows)
        jpegs = (encode_jpeg(sheet, quality) for quality in (80, 65, 50, 35, 20))
        jpeg = next((one for one in jpegs if len(one) <= MOST_BYTES), encode_jpeg(sheet, 5))
        return Film(end_s=end_s, camera=self._camera(window)), {FILM: jpeg}

    def _nearest(self, t_s: float) -> Frame:
        return min(self.frames, key=lambda frame: abs(frame.t_s - self.t_start_s - t_s))

    def _picture(self, frame: Frame, window: tuple[int, int, int, int], size_px: int) -> Image:
        """The frame cut to the window; a ring marks the object's centre, a line its path until then."""
        left, top, right, bottom = window
        cut = cv2.resize(frame.colour[top:bottom, left:right], (size_px, size_px), interpolation=cv2.INTER_AREA)
        picture, scale = np.array(cut, np.uint8), size_px / np.array([right - left, bottom - top])
        if self.goal_m is not None:
            turn = np.linspace(0, 2 * np.pi, 37)
            ring_m = np.column_stack([self.goal_m + _GOAL_M * np.column_stack([np.cos(turn), np.sin(turn)]), 0 * turn])
            ring = np.round((_pixels(self.model, self.X_BC, ring_m) - [left, top]) * scale * 2**_SHIFT)
            cv2.polylines(picture, [ring.astype(np.int32)], False, _GOAL_RGB, 1, cv2.LINE_AA, _SHIFT)
        way = (way_px(self.model, self.X_BC, self.track, frame.t_s - self.t_start_s) - [left, top]) * scale
        draw_way(picture, way, round(size_px / 44))
        return picture

    def _window(self, *, with_goal: bool = False) -> tuple[int, int, int, int]:
        """A square (left, top, right, bottom) around the object's path, in pixels of the colour image, inside it."""
        colour, path_m = self.model.colour, self.track.state[:, :3]
        reach_m = _FALLEN_REACH_M if self.track.outcome is Outcome.TIPPED else _REACH_M
        seen_m = np.concatenate([self.found_m[None], path_m[:, :2]])
        if with_goal and self.goal_m is not None:
            seen_m = np.concatenate([seen_m, self.goal_m[None]])
        low_m, high_m = seen_m.min(axis=0) - reach_m, seen_m.max(axis=0) + reach_m
        top_m = max(path_m[:, 2].max(), 0.0) + path_m[:, 2].min()  # the highest centre and half the object's height
        corners = [[x, y, z] for x in (low_m[0], high_m[0]) for y in (low_m[1], high_m[1]) for z in (0.0, top_m)]
        pixels = _pixels(self.model, self.X_BC, np.array(corners))
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        half = min((high - low).max(), colour.height, colour.width) / 2
        middle = np.clip((low + high) / 2, half, np.array([colour.width, colour.height]) - half)
        left, top = np.floor(middle - half).astype(int)
        right, bottom = np.ceil(middle + half).astype(int)
        return max(left, 0), max(top, 0), min(right, colour.width), min(bottom, colour.height)

    def _camera(self, window: tuple[int, int, int, int]) -> tuple[float, ...]:
        """See `Film.camera`: the camera without its distortion, shifted to where the path of the object is seen."""
        left, top, right, bottom = window
        path_m = self.track.state[:, :3]
        P = self.model.colour.K @ inverse(self.X_BC)[:3]
        straight = np.column_stack([path_m, np.ones(len(path_m))]) @ P.T
        bent = np.mean(_pixels(self.model, self.X_BC, path_m) - straight[:, :2] / straight[:, 2:], axis=0)
        shift = np.array([[1, 0, bent[0] - left], [0, 1, bent[1] - top], [0, 0, 1]])
        return tuple((np.diag([1 / (right - left), 1 / (bottom - top), 1]) @ shift @ P).ravel().tolist())


def way_px(model: CameraModel, X_BC: Array, track: ObjectTrack, until_s: float) -> Array:
    """(N, 2) the centre in the colour image at every tracked time up to `until_s`, and at that time."""
    before = track.state[track.t_s < until_s, :3]
    return _pixels(model, X_BC, np.concatenate([before, track.at(np.array([until_s]))[:, :3]]))


def draw_way(picture: Image, way: Array, ring_px: int) -> None:
    """Draw a path (N, 2) in pixels, and a ring around its end, into an RGB picture."""
    points = np.round(way * 2**_SHIFT).astype(np.int32)
    centre = (int(points[-1, 0]), int(points[-1, 1]))
    for colour, width in ((_DARK, 4), (_WAY_RGB, 2)):
        cv2.polylines(picture, [points.reshape(-1, 1, 2)], False, colour, width - 1, cv2.LINE_AA, _SHIFT)
        cv2.circle(picture, centre, ring_px << _SHIFT, colour, width, cv2.LINE_AA, _SHIFT)


def write(picture: Image, text: str, at_px: tuple[int, int], scale: float) -> None:
    """Write white text with a dark rim into a picture."""
    for colour, width in ((_DARK, 3), ((255, 255, 255), 1)):
        cv2.putText(picture, text, at_px, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, width, cv2.LINE_AA)


def _pixels(model: CameraModel, X_BC: Array, p_m: Array) -> Array:
    """(N, 3) in the base frame -> (N, 2) in the colour image."""
    X_CB, colour = inverse(X_BC), model.colour
    pixels, _ = cv2.projectPoints(
        p_m @ X_CB[:3, :3].T + X_CB[:3, 3], np.zeros(3), np.zeros(3), colour.K, colour.distortion
    )
    return np.asarray(pixels.reshape(-1, 2), np.float64)
