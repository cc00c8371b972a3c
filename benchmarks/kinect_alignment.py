"""How well depth and colour agree in a recording of an Azure Kinect, at the outlines of near objects; with a picture.

    python benchmarks/kinect_alignment.py RECORDING.mkv --out docs/figures/kinect-alignment.png

It also measures with the depth camera turned by a known angle, which shows how sensitive the number is.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from kinect_recording import KinectRecording
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hw.errors import CameraError
from hw.poses import pose
from hw.types import Array, CameraModel, Frame, Intrinsics
from perception.geometry import project, transform

JUMP_M = 0.04
"""Between two neighbouring pixels of depth: more than any smooth surface has."""
_SIDES = ((0, 1), (0, -1))  # upper and lower outlines of what stands on a table are few
_GAP_PX = 5  # of the depth image
_REACH_PX = 8  # of the colour image, to both sides of the outline
_STEP_PX = 0.25
_LEAST_CONTRAST = 12.0  # grey values: a weaker edge may be texture or shadow
_LEAST_POINTS = 60


@dataclass(frozen=True, eq=False)
class Alignment:
    """Outline points in the colour image, and their distances to the edge of the colour."""

    outline_px: Array  # (N, 2) u, v where depth says that the near side ends
    normal: Array  # (N, 2) unit, away from the near side
    beside_px: Array  # (N,) from there to the edge of the colour image, along the normal

    @property
    def shift_px(self) -> float:
        """One sideways shift of the whole depth image (along u) that explains the offsets best, beside the growth."""
        return float(self._fit[0])

    @property
    def growth_px(self) -> float:
        """How much farther out the outline lies in colour than in depth. Pixels that see both sides give no depth."""
        return float(self._fit[1])

    @property
    def median_px(self) -> float:
        """Of the offsets' size."""
        return float(np.median(np.abs(self.beside_px)))

    @property
    def _columns(self) -> Array:
        return np.column_stack([self.normal[:, 0], np.ones(len(self.normal))])

    @cached_property
    def _fit(self) -> Array:
        """(shift, growth): least absolute deviations by reweighting, so that texture does not count."""
        columns, weight = self._columns, np.ones(len(self.beside_px))
        fit: Array = np.zeros(2)
        for _ in range(50):
            solution = np.linalg.lstsq(columns * weight[:, None], self.beside_px * weight, rcond=None)
            fit = np.asarray(solution[0], dtype=np.float64)
            weight = 1.0 / np.sqrt(np.maximum(np.abs(self.beside_px - columns @ fit), 0.05))
        return fit


def points_in_colour(depth_mm: NDArray[np.uint16], model: CameraModel) -> tuple[Array, Array, NDArray[np.bool_]]:
    """(pixels (H, W, 2) in the colour image, depths (H, W) from the colour camera in m, valid (H, W)) of a depth image.

    Both lenses' distortion is taken into account.
    """
    height, width = depth_mm.shape
    v, u = np.mgrid[:height, :width].astype(np.float64)
    rays = undistorted(np.stack([u, v], axis=-1).reshape(-1, 2), model.depth)
    z_m = depth_mm.reshape(-1) * 1e-3
    p_D_m = np.column_stack([rays * z_m[:, None], z_m])
    p_C_m = transform(model.X_CD, p_D_m)
    valid = (z_m > 0) & (p_C_m[:, 2] > 0.05)
    pixels = np.zeros((len(z_m), 2))
    pixels[valid] = project(model.colour, np.eye(4), p_C_m[valid])
    shape = (height, width)
    return pixels.reshape(*shape, 2), p_C_m[:, 2].reshape(shape), valid.reshape(shape)


def undistorted(pixels: Array, camera: Intrinsics) -> Array:
    """Rays (N, 2) at z = 1 of pixels (N, 2); iterated until the lens model's inverse is exact to 1e-9."""
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
    rays = cv2.undistortPointsIter(pixels[:, None], camera.K, camera.distortion, None, None, stop)
    return np.asarray(rays, dtype=np.float64).reshape(-1, 2)


def align(frame: Frame, model: CameraModel, nearest_m: float, farthest_m: float) -> Alignment:
    """The left and right outlines of objects between these distances (of the depth camera) compared with the edges in
    colour.

    A pixel of depth is at an outline when the next reading beside it (within five pixels: those that see both sides
    have none) is further away by `JUMP_M`. Raises CameraError when fewer than 60 points are clear.
    """
    pixels, _, valid = points_in_colour(frame.depth_mm, model)
    z_m = np.where(valid, frame.depth_mm * 1e-3, 0.0)
    grey = cv2.GaussianBlur(cv2.cvtColor(frame.colour, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.0)
    outline, normals = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for side in _SIDES:
        rows, columns = np.nonzero(_ends(z_m, side, nearest_m, farthest_m))
        end, before = pixels[rows, columns], pixels[rows - side[0], columns - side[1]]
        outline.append(end + 0.5 * (end - before))  # the outline lies between this pixel and the next
        normals.append((end - before) / np.linalg.norm(end - before, axis=1, keepdims=True))
    places, ways = np.concatenate(outline), np.concatenate(normals)
    beside_px, clear = _edges(grey, places, ways)
    if clear.sum() < _LEAST_POINTS:
        raise CameraError(
            f"only {clear.sum()} clear points on outlines between {nearest_m:g} and {farthest_m:g} m, at least "
            f"{_LEAST_POINTS} are needed: film something near with a plain background"
        )
    return Alignment(places[clear], ways[clear], beside_px[clear])


def _ends(z_m: Array, side: tuple[int, int], nearest_m: float, farthest_m: float) -> NDArray[np.bool_]:
    """(H, W) where an object within the distances ends towards `side` (rows, columns) and continues on the other."""
    near = (z_m > nearest_m) & (z_m < farthest_m)
    inner = np.roll(z_m, side, axis=(0, 1))
    ends = near & (np.abs(inner - z_m) < 0.25 * JUMP_M)
    found, open_ = np.zeros_like(ends), ends.copy()
    for steps in range(1, _GAP_PX + 1):
        next_m = np.roll(z_m, (-steps * side[0], -steps * side[1]), axis=(0, 1))
        found |= open_ & (next_m - z_m > JUMP_M)
        open_ &= next_m == 0.0
    border = _GAP_PX + 1
    found[:border] = found[-border:] = False
    found[:, :border] = found[:, -border:] = False
    return np.asarray(found)


def _edges(grey: NDArray[np.float32], places: Array, ways: Array) -> tuple[Array, NDArray[np.bool_]]:
    """(N,) the clear edge of the colour nearest to each place along its normal, in pixels; and whether there is one.

    A clear edge is a peak of the slope at least half as high as the highest nearby, because an object has a pattern of
    its own.
    """
    along_px = np.arange(-_REACH_PX, _REACH_PX + _STEP_PX / 2, _STEP_PX)
    if not len(places):
        return np.zeros(0), np.zeros(0, bool)
    at = places[:, None] + along_px[None, :, None] * ways[:, None]
    profile = cv2.remap(grey, at[..., 0].astype(np.float32), at[..., 1].astype(np.float32), cv2.INTER_LINEAR)
    slope = np.abs(np.gradient(profile, _STEP_PX, axis=1))
    peak = (slope >= np.roll(slope, 1, axis=1)) & (slope > np.roll(slope, -1, axis=1))
    peak &= slope >= 0.5 * slope.max(axis=1, keepdims=True)
    peak[:, :2] = peak[:, -2:] = False
    best = np.where(peak, np.abs(along_px), np.inf).argmin(axis=1)
    contrast = np.where(peak.any(axis=1), np.ptp(profile, axis=1), 0.0)
    height, width = grey.shape
    inside = (at > 0).all(axis=(1, 2)) & (at[..., 0] < width - 1).all(axis=1) & (at[..., 1] < height - 1).all(axis=1)
    return along_px[best], (contrast > _LEAST_CONTRAST) & inside


TURNS_DEG = (-0.4, -0.2, 0.0, 0.2, 0.4)
ZOOM = 2
NEAR_M, FAR_M = 0.2, 0.5


def turned(model: CameraModel, angle_deg: float) -> CameraModel:
    """The depth camera turned about the colour camera's vertical axis."""
    R = Rotation.from_rotvec([0.0, np.deg2rad(angle_deg), 0.0]).as_matrix()
    return replace(model, X_CD=pose(R, np.zeros(3)) @ model.X_CD)


def picture(frame: Frame, model: CameraModel, found: Alignment) -> np.ndarray:
    """Left: near readings on the colour image; right: outlines of depth (red) and edges of colour (green), enlarged."""
    low = np.maximum(found.outline_px.min(axis=0).astype(int) - 30, 0)
    high = np.minimum(found.outline_px.max(axis=0).astype(int) + 30, frame.colour.shape[1::-1])
    part = frame.colour[low[1] : high[1], low[0] : high[0]]
    grey = cv2.cvtColor(cv2.resize(part, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_CUBIC), cv2.COLOR_RGB2GRAY)
    steps = 10 * (cv2.medianBlur(grey, 5) // 10)  # few grey values: the picture stays small
    large = np.repeat(steps[..., None], 3, axis=2)
    readings, edges = large.copy(), large
    pixels, z_m, valid = points_in_colour(frame.depth_mm, model)
    near = valid & (z_m < FAR_M) & (pixels > low).all(axis=-1) & (pixels < high - 1).all(axis=-1)
    for (u, v), depth_m in zip((pixels[near] - low + 0.5) * ZOOM, z_m[near], strict=True):
        shade = float(np.clip(2.0 * depth_m / FAR_M - 1.0, 0, 1))
        readings[min(round(v), len(grey) - 1), min(round(u), grey.shape[1] - 1)] = (255 * (1 - shade), 90, 255 * shade)
    ends_px = found.outline_px + found.beside_px[:, None] * found.normal
    for places, colour in ((found.outline_px, (230, 30, 30)), (ends_px, (40, 220, 40))):
        for u, v in (places - low + 0.5) * ZOOM:
            cv2.circle(edges, (round(u), round(v)), 1, colour, -1)
    return np.hstack([readings, edges])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--out", type=Path, help="PNG to write")
    given = parser.parse_args()
    with KinectRecording(given.recording) as recording:
        model, frame = recording.model(), next(recording.frames())
    print("turned by   points   |offset| median   sideways shift   growth")
    for angle_deg in TURNS_DEG:
        found = align(frame, turned(model, angle_deg), NEAR_M, FAR_M)
        expected_px = np.deg2rad(angle_deg) * model.colour.K[0, 0]
        print(
            f"{angle_deg:+5.1f}°  {len(found.beside_px):9d}  {found.median_px:12.2f} px  {found.shift_px:+12.2f} px"
            f"  {found.growth_px:+6.2f} px   (turned by {expected_px:+.2f} px)"
        )
    if given.out is not None:
        image = picture(frame, model, align(frame, model, NEAR_M, FAR_M))
        content = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
        given.out.write_bytes(content.tobytes())
        print(f"written: {given.out}, {given.out.stat().st_size // 1024} KB")


if __name__ == "__main__":
    main()
