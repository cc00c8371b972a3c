"""Checks of the camera before a calibration: intrinsics, exposure, sharpness, temperature."""

from __future__ import annotations

import cv2
import numpy as np

from adaptsim_cli.screen.views import Readiness
from hw.types import Array, CameraModel, Frame, Intrinsics
from perception.board.types import Corners

SATURATED, DARK = 250, 12
MOST_SATURATED, MOST_DARK = 0.25, 0.60
LEAST_CONTRAST = 60.0
WIDEST_EDGE_PX = 4.0
WARM_UP_MIN = 40


def before(frame: Frame, model: CameraModel) -> tuple[Readiness, ...]:
    """Checks on any picture of the scene, before anything moves."""
    return (_intrinsics(frame, model.colour), _exposure(frame))


def warm(real: bool, temperature_C: float | None) -> Readiness:
    """A reminder that never fails, because cameras do not report how long they have been on."""
    if not real:
        return Readiness("warm-up", True, "a simulated camera needs none")
    now = "it does not report its temperature" if temperature_C is None else f"{temperature_C:.1f} °C now"
    return Readiness("warm-up", True, f"{now}; its depth is stable {WARM_UP_MIN} minutes after switching on")


def at_board(frame: Frame, corners: Corners) -> tuple[Readiness, ...]:
    """Checks on a picture with the board: contrast of the print, and width of its edges."""
    grey = cv2.cvtColor(frame.colour, cv2.COLOR_RGB2GRAY).astype(np.float32)
    black, white = _levels(grey, corners)
    contrast = white - black
    edge_px = _edge_width(grey, corners, contrast)
    return (
        Readiness(
            "contrast",
            contrast >= LEAST_CONTRAST and white < SATURATED,
            f"print {black:.0f} to {white:.0f} of 255"
            + ("" if contrast >= LEAST_CONTRAST else f", {LEAST_CONTRAST:g} apart needed: more light on the board")
            + ("" if white < SATURATED else ": overexposed, shorten the exposure"),
        ),
        Readiness(
            "sharpness",
            edge_px <= WIDEST_EDGE_PX,
            f"edges {edge_px:.1f} px wide"
            + ("" if edge_px <= WIDEST_EDGE_PX else f", limit {WIDEST_EDGE_PX:g}: clean the lens, check the focus"),
        ),
    )


def _intrinsics(frame: Frame, camera: Intrinsics) -> Readiness:
    fx, fy = float(camera.K[0, 0]), float(camera.K[1, 1])
    size = (frame.colour.shape[1], frame.colour.shape[0])
    if size != (camera.width, camera.height):
        return Readiness(
            "intrinsics",
            False,
            f"pictures are {size[0]} × {size[1]}, the intrinsics are for {camera.width} × {camera.height}: "
            "read the intrinsics for this resolution from the camera",
        )
    view_deg = float(2 * np.rad2deg(np.arctan(camera.width / 2 / fx)))
    if not (20 < view_deg < 130 and 0.9 < fx / fy < 1.1):
        return Readiness("intrinsics", False, f"fx = {fx:.1f}, fy = {fy:.1f} px: implausible for pictures of this size")
    return Readiness(
        "intrinsics", True, f"fx = {fx:.1f}, fy = {fy:.1f} px, {view_deg:.0f}° wide, lens distortion known"
    )


def _exposure(frame: Frame) -> Readiness:
    grey = cv2.cvtColor(frame.colour, cv2.COLOR_RGB2GRAY)
    bright, dark = float((grey >= SATURATED).mean()), float((grey <= DARK).mean())
    if bright > MOST_SATURATED:
        return Readiness(
            "exposure", False, f"{100 * bright:.0f} % of the picture is white: shorten the exposure or reduce the light"
        )
    if dark > MOST_DARK:
        return Readiness(
            "exposure", False, f"{100 * dark:.0f} % of the picture is black: add light or lengthen the exposure"
        )
    return Readiness("exposure", True, f"mean grey {grey.mean():.0f} of 255")


def _levels(grey: Array, corners: Corners) -> tuple[float, float]:
    """Grey of ink and of paper, over the print."""
    low, high = corners.px.min(axis=0).astype(int), corners.px.max(axis=0).astype(int) + 1
    patch = grey[low[1] : high[1], low[0] : high[0]]
    return float(np.percentile(patch, 10)), float(np.percentile(patch, 90))


def _edge_width(grey: Array, corners: Corners, contrast: float) -> float:
    """The median width of an edge from black to white: the contrast over the steepest slope beside each corner."""
    slope = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=1 / 8))
    steepest = cv2.dilate(slope, np.ones((9, 9), np.uint8))
    u, v = np.rint(corners.px).astype(int).T
    return contrast / max(float(np.median(steepest[v, u])), 1e-3)
