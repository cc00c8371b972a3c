"""The cylinder that stands on a table in a real recording of an Azure Kinect, and a picture of the result.

    python benchmarks/mug.py recording.mkv [--png mug.png]

Needs PyAV (`pip install av`).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from kinect_recording import KinectRecording

from hw.poses import inverse
from hw.types import Array, CameraModel, Frame
from perception.arm_mask import NO_ARM
from perception.clutter import Thing, things
from perception.cylinder import Circle, Cylinder, fit_circle
from perception.errors import ObjectNotFound, TableNotFound
from perception.geometry import ImageRegion, project
from perception.scan import Scan

_TRIES, _SAMPLE = 400, 4000


@dataclass(frozen=True, eq=False)
class Plane:
    """Points with normal . p = offset_m."""

    normal: Array  # (3,) unit
    offset_m: float
    share: float  # of the points asked that lie on it
    rms_m: float  # of these


def find_plane(
    points_m: Array, up: Array, rng: np.random.Generator, within_rad: float = 0.45, near_m: float = 0.006
) -> Plane:
    """The plane that most of `points_m` (N, 3) lie on, of those with a normal within `within_rad` of `up` (3,).

    Random triples (Fischler and Bolles, 1981), then least squares over the points within `near_m`. Raises TableNotFound
    when no such plane holds a fiftieth of the points.
    """
    few = points_m[rng.choice(len(points_m), min(_SAMPLE, len(points_m)), replace=False)]
    corners = few[rng.integers(0, len(few), (_TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(length, 1e-12)[:, None]
    normals *= np.where(normals @ up < 0, -1.0, 1.0)[:, None]
    good = (length > 1e-5) & (normals @ up > np.cos(within_rad))
    offsets = np.einsum("ti,ti->t", normals, corners[:, 0])
    count = np.where(good, (np.abs(few @ normals.T - offsets) < near_m).sum(axis=0), 0)
    best = int(count.argmax())
    if count[best] < len(few) / 50:
        raise TableNotFound(
            f"no plane that faces up holds a fiftieth of the {len(points_m)} points; point the camera at the table"
        )
    normal, offset_m = normals[best], float(offsets[best])
    for _ in range(8):
        on = points_m[np.abs(points_m @ normal - offset_m) < near_m]
        middle = on.mean(axis=0)
        _, _, axes = np.linalg.svd(np.linalg.qr(on - middle, mode="r"))
        normal = axes[2] * np.sign(axes[2] @ up)
        offset_m = float(normal @ middle)
    left = points_m @ normal - offset_m
    near = np.abs(left) < near_m
    return Plane(normal, offset_m, float(near.mean()), float(np.sqrt(np.mean(left[near] ** 2))))


def table_frame(plane: Plane) -> Array:
    """(4, 4) pose X_BV of a camera, given the table in its frame: Z up from the table, X where it looks, Y left.

    The origin lies on the table below the camera.
    """
    z = plane.normal
    x = np.array([0.0, 0.0, 1.0]) - z[2] * z
    x /= np.linalg.norm(x)
    R_BV = np.stack([x, np.cross(z, x), z])
    X = np.eye(4)
    X[:3, :3], X[2, 3] = R_BV, -plane.offset_m
    return X


_RADIUS_M, _RADIUS_STD_M = 0.040, 0.015  # what stands on tables and can be held in a hand
_RIM_M = 0.010  # top and bottom of a side are left out: rims, and the fillet at the table
_FEWEST = 200
_LARGEST_RMS_M = 0.004


@dataclass(frozen=True, eq=False)
class Standing:
    """A cylinder that stands on the table of a survey."""

    circle: Circle  # in the table's frame
    height_m: float
    thing: Thing


@dataclass(frozen=True, eq=False)
class Survey:
    """A table and the cylinder on it; the table's frame B has z = 0 on the table, X where the camera looks."""

    table: Plane  # in the depth camera
    X_BC: Array  # (4, 4) colour camera in the table's frame
    cylinder: Standing


def survey(
    frame: Frame, model: CameraModel, up: Array, rng: np.random.Generator, most_m: float = 1.0, table_m: float = 0.006
) -> Survey:
    """The table in the depth image within `most_m`, and the largest cylinder that stands on it.

    `up` (3,) is roughly the vertical in the depth camera. Raises TableNotFound, ObjectNotFound.
    """
    everything = ImageRegion(model.depth, np.eye(4), slice(0, model.depth.height), slice(0, model.depth.width))
    camera = Scan(everything)
    depth_m = camera.depth(frame.depth_mm)
    points = camera.points(depth_m, (depth_m > 0) & (depth_m < most_m))
    table = find_plane(points, up, rng, near_m=table_m)
    X_BD = table_frame(table)
    scan = Scan(ImageRegion(model.depth, X_BD, everything.rows, everything.columns))
    near = np.where(depth_m < most_m, frame.depth_mm, np.uint16(0))
    standing = [_standing(scan, thing) for thing in things(scan, near, NO_ARM)]
    good = [s for s in standing if s is not None and s.circle.rms_m < _LARGEST_RMS_M]
    if not good:
        raise ObjectNotFound(f"none of the {len(standing)} things on the table is a cylinder; show it from the side")
    largest = max(good, key=lambda s: len(s.thing.points_m))
    return Survey(table, X_BD @ inverse(model.X_CD), largest)


def _standing(scan: Scan, thing: Thing) -> Standing | None:
    """The upright cylinder through the side of an object; None if too little of the side is visible."""
    height = thing.points_m[:, 2]
    side = thing.points_m[(height > 2 * _RIM_M) & (height < thing.height_m - _RIM_M), :2]
    if len(side) < _FEWEST:
        return None
    middle = np.median(side, axis=0)
    away = (middle - scan.view.X_BV[:2, 3]) / np.linalg.norm(middle - scan.view.X_BV[:2, 3])
    circle = fit_circle(side, middle + 2 / np.pi * _RADIUS_M * away, _RADIUS_M, _RADIUS_STD_M)
    return Standing(circle, thing.height_m, thing)


UP = np.array([0.0, -1.0, 0.0])  # in the depth camera, which stood about level
READ_RGB, FOUND_RGB = (255, 60, 60), (30, 220, 60)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--png", type=Path)
    args = parser.parse_args()
    with KinectRecording(args.recording) as recording:
        model, frame = recording.model(), next(recording.frames())
    seen = survey(frame, model, UP, np.random.default_rng(0))
    circle, table = seen.cylinder.circle, seen.table
    print(
        f"table: {1e2 * seen.X_BC[2, 3]:.1f} cm below the colour camera, tilted "
        f"{np.rad2deg(np.arccos(table.normal @ UP)):.1f}° against it, residual {1e3 * table.rms_m:.2f} mm, "
        f"{100 * table.share:.0f} % of the readings\n"
        f"cylinder: radius {1e3 * circle.radius_m:.1f} mm, height {1e3 * seen.cylinder.height_m:.0f} mm, residual "
        f"{1e3 * circle.rms_m:.2f} mm over {100 * circle.share:.0f} % of the readings on its side"
    )
    if args.png:
        cv2.imwrite(str(args.png), drawn(frame, model, seen)[..., ::-1])


def drawn(frame: Frame, model: CameraModel, seen: Survey) -> Array:
    """(h, w, 3) RGB: readings above the table, and the rims of the cylinder fitted to them."""
    image, X_CB, circle = frame.colour.copy(), inverse(seen.X_BC), seen.cylinder.circle
    for u, v in project(model.colour, X_CB, seen.cylinder.thing.points_m[::7]):
        cv2.circle(image, (round(u), round(v)), 1, READ_RGB, -1)
    middle = np.array([*circle.centre_m, seen.cylinder.height_m / 2])
    rims = Cylinder(circle.radius_m, seen.cylinder.height_m).rims_m + middle
    rims_px = project(model.colour, X_CB, rims)
    for rim in np.split(rims_px, 3):
        cv2.polylines(image, [np.rint(16 * rim).astype(np.int32)], True, FOUND_RGB, 2, cv2.LINE_AA, 4)
    text = f"radius {1e3 * circle.radius_m:.1f} mm, residual {1e3 * circle.rms_m:.1f} mm"
    for rgb, thick in (((0, 0, 0), 4), (FOUND_RGB, 2)):
        cv2.putText(image, text, (610, 560), cv2.FONT_HERSHEY_SIMPLEX, 0.9, rgb, thick, cv2.LINE_AA)
    left, top = np.clip(rims_px.min(axis=0).astype(int) - 80, 0, None)
    return np.asarray(image[top:, left : left + 930])


if __name__ == "__main__":
    main()
