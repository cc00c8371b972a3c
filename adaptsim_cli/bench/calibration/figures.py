"""The figures of a calibration's page, as inline SVG."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptsim_cli.screen.svg import Canvas, Scale, plain
from calib.checks import Residuals
from calib.saved import UncertaintyRecord
from calib.types import View, ViewFit
from hw.types import Intrinsics

_WIDTH = 760.0
ENLARGED = 20.0
"""Enlargement of residual vectors in their figure."""


def coverage(views: Sequence[View], used: frozenset[str], camera: Intrinsics) -> str:
    """Every corner found, in the frame of the image; unused views stand out."""
    canvas, x, y = _image_frame(camera, "Where in the image the board was seen")
    for k in range(1, 4):
        canvas.line(x(camera.width * k / 4), y(0), x(camera.width * k / 4), y(camera.height), "grid")
    for k in range(1, 3):
        canvas.line(x(0), y(camera.height * k / 3), x(camera.width), y(camera.height * k / 3), "grid")
    for view in views:
        css = "seen c0" if view.name in used else "seen c5"
        for u, v in view.corners.px:
            canvas.dot(x(u), y(v), 2, css, view.name)
    return canvas.svg()


def residuals(views: Sequence[ViewFit]) -> str:
    """The error of each view's corners under the result, and under the view's own best pose."""
    left, right, top, bottom = 44.0, _WIDTH - 8, 10.0, 210.0
    canvas = Canvas(_WIDTH, bottom + 40, "Residuals of every view in pixels")
    high = 1.1 * max([v.rms_px or 0.0 for v in views if v.used] + [v.held_out_px or 0.0 for v in views] + [0.2])
    x, y = Scale(-0.6, len(views) - 0.4, left, right), Scale(0, high, bottom, top)
    for tick in y.ticks(4):
        canvas.line(left, y(tick), right, y(tick), "grid")
        canvas.text(left - 6, y(tick) + 4, plain(round(tick, 6)), anchor="end")
    step = -(-len(views) // 12)  # so that names do not overlap on a narrow screen
    for i, view in enumerate(views):
        if i % step == 0:
            canvas.text(x(i), bottom + 16, view.name, anchor="middle")
        tooltip = f"view {view.name}: {_px(view.rms_px)}, by itself {_px(view.own_rms_px)}"
        if not view.used:
            canvas.line(x(i), bottom, x(i), top, "band")
            canvas.text(x(i), top + 10, "×", "bad-mark", "middle")
            continue
        canvas.line(x(i), y(view.own_rms_px or 0.0), x(i), y(view.rms_px or 0.0), "mean")
        canvas.dot(x(i), y(view.own_rms_px or 0.0), 3, "dot open c0", tooltip)
        canvas.dot(x(i), y(view.rms_px or 0.0), 4, "dot c0", tooltip)
        if view.held_out_px is not None:
            canvas.dot(x(i), y(view.held_out_px), 4, "dot c1", f"view {view.name} held out: {_px(view.held_out_px)}")
    canvas.text((left + right) / 2, bottom + 34, "view", anchor="middle")
    return canvas.svg()


def vectors(views: Sequence[Residuals], camera: Intrinsics) -> str:
    """Vectors from predicted to observed points, enlarged, in the frame of the image; used views only."""
    canvas, x, y = _image_frame(camera, f"Residuals as vectors, enlarged {ENLARGED:.0f} times")
    for view in views:
        if not view.used:
            continue
        for (u, v), (du, dv) in zip(view.px - view.off_px, ENLARGED * view.off_px, strict=True):
            canvas.line(x(u), y(v), x(u + du), y(v + dv), "mean")
            canvas.dot(x(u), y(v), 1.2, "seen c0", f"view {view.name}")
    return canvas.svg()


def work_volume(uncertainty: UncertaintyRecord, camera_m: tuple[float, float]) -> str:
    """The corners of the work volume from above, with the error that 95 % of calibrations stay below."""
    points = np.array(uncertainty.points_m)
    spot = np.array([*points[:, :2], (0.0, 0.0), camera_m])
    low, high = spot.min(axis=0) - 0.15, spot.max(axis=0) + 0.15
    left, top, tall = 48.0, 10.0, 300.0
    per_m = min(tall / (high[1] - low[1]), (_WIDTH - left - 8) / (high[0] - low[0]))
    right, bottom = left + per_m * (high[0] - low[0]), top + per_m * (high[1] - low[1])
    canvas = Canvas(_WIDTH, bottom + 44, "Error at the corners of the work volume, seen from above")
    x, y = Scale(low[0], high[0], left, right), Scale(low[1], high[1], bottom, top)
    canvas.grid(x, y)
    box = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    canvas.rect(x(box[0][0]), y(box[1][1]), x(box[1][0]) - x(box[0][0]), y(box[0][1]) - y(box[1][1]), "area", 2)
    for place in np.unique(points[:, :2], axis=0):
        here = np.flatnonzero((np.abs(points[:, :2] - place) < 1e-9).all(axis=1))
        lines = [f"{uncertainty.work_95_mm[i]:.2f} mm at z = {points[i, 2]:.2f}" for i in here]
        worst = max(uncertainty.work_95_mm[i] for i in here)
        canvas.dot(x(place[0]), y(place[1]), float(np.clip(4 * worst, 3, 40)), "dot c0 faint", ", ".join(lines))
        outwards = 20.0 if place[1] < points[:, 1].mean() else -12.0 - 14 * (len(lines) - 1)
        for row, text in enumerate(lines):
            canvas.text(x(place[0]), y(place[1]) + outwards + 14 * row, text, "ink", "middle")
    canvas.dot(x(0), y(0), 5, "dot c3", "the arm's base")
    canvas.text(x(0) + 8, y(0) + 4, "arm")
    canvas.dot(x(camera_m[0]), y(camera_m[1]), 5, "dot c1", "the camera")
    canvas.text(x(camera_m[0]) - 8, y(camera_m[1]) + 4, "camera", anchor="end")
    canvas.text((left + right) / 2, bottom + 36, "x in metres, away from the robot", anchor="middle")
    return canvas.svg()


def _image_frame(camera: Intrinsics, title: str) -> tuple[Canvas, Scale, Scale]:
    """A canvas with the frame of the image, and the scales of its pixels."""
    width = 560.0
    height = width * camera.height / camera.width
    canvas = Canvas(width + 2, height + 2, title)
    canvas.rect(1, 1, width, height, "table", 4)
    return canvas, Scale(0, camera.width, 1, 1 + width), Scale(0, camera.height, 1, 1 + height)


def _px(value: float | None) -> str:
    return "not measured" if value is None else f"{value:.2f} px"
