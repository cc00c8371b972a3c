"""How well depth lies on colour in a recording of an Azure Kinect, on the outlines of what stands near; with a picture.

    python benchmarks/kinect_alignment.py RECORDING.mkv --near 0.2 --far 0.5 --out docs/figures/kinect-alignment.png

Also says what it finds when the depth camera is turned by a known angle: what the number can tell.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from colour_against_depth import Alignment, align, points_in_colour
from scipy.spatial.transform import Rotation

from hw.camera.recording import KinectRecording
from hw.types import CameraModel, Frame

TURNS_DEG = (-0.4, -0.2, 0.0, 0.2, 0.4)
ZOOM = 2


def turned(model: CameraModel, angle_deg: float) -> CameraModel:
    """The depth camera turned about the colour camera's vertical axis."""
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.0, np.deg2rad(angle_deg), 0.0]).as_matrix()
    return replace(model, X_CD=X @ model.X_CD)


def picture(frame: Frame, model: CameraModel, found: Alignment, far_m: float) -> np.ndarray:
    """Left: near readings on the colour image; right: outlines of depth (red) and edges of colour (green), enlarged."""
    low = np.maximum(found.outline_px.min(axis=0).astype(int) - 30, 0)
    high = np.minimum(found.outline_px.max(axis=0).astype(int) + 30, frame.colour.shape[1::-1])
    part = frame.colour[low[1] : high[1], low[0] : high[0]]
    grey = cv2.cvtColor(cv2.resize(part, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_CUBIC), cv2.COLOR_RGB2GRAY)
    steps = 10 * (cv2.medianBlur(grey, 5) // 10)  # few grey values: the picture stays small
    large = np.repeat(steps[..., None], 3, axis=2)
    readings, edges = large.copy(), large
    pixels, z_m, valid = points_in_colour(frame.depth_mm, model)
    near = valid & (z_m < far_m) & (pixels > low).all(axis=-1) & (pixels < high - 1).all(axis=-1)
    for (u, v), depth_m in zip((pixels[near] - low + 0.5) * ZOOM, z_m[near], strict=True):
        shade = float(np.clip(2.0 * depth_m / far_m - 1.0, 0, 1))
        readings[min(round(v), len(grey) - 1), min(round(u), grey.shape[1] - 1)] = (255 * (1 - shade), 90, 255 * shade)
    ends_px = found.outline_px + found.beside_px[:, None] * found.normal
    for places, colour in ((found.outline_px, (230, 30, 30)), (ends_px, (40, 220, 40))):
        for u, v in (places - low + 0.5) * ZOOM:
            cv2.circle(edges, (round(u), round(v)), 1, colour, -1)
    return np.hstack([readings, edges])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--near", type=float, default=0.2, help="m")
    parser.add_argument("--far", type=float, default=0.5, help="m")
    parser.add_argument("--out", type=Path, help="PNG to write")
    given = parser.parse_args()
    with KinectRecording(given.recording) as recording:
        model, frame = recording.model(), next(recording.frames())
    print("turned by   points   |offset| median   sideways shift   growth   scatter")
    for angle_deg in TURNS_DEG:
        found = align(frame, turned(model, angle_deg), given.near, given.far)
        expected_px = np.deg2rad(angle_deg) * model.colour.K[0, 0]
        print(
            f"{angle_deg:+5.1f}°  {len(found.beside_px):9d}  {found.median_px:12.2f} px  {found.shift_px:+12.2f} px"
            f"  {found.growth_px:+6.2f} px  {found.scatter_px:5.2f} px   (turned by {expected_px:+.2f} px)"
        )
    if given.out is not None:
        image = picture(frame, model, align(frame, model, given.near, given.far), given.far)
        content = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
        given.out.write_bytes(content.tobytes())
        print(f"written: {given.out}, {given.out.stat().st_size // 1024} KB")


if __name__ == "__main__":
    main()
