"""The cylinder that stands on a table in a real recording of an Azure Kinect, and a picture of what was found.

    python benchmarks/tracked/mug.py recording.mkv [--png mug.png]

Needs PyAV (`pip install adaptsim[kinect]`).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np

sys.path.append(str(Path(__file__).parents[2] / "tests" / "support"))
from survey import Survey, survey

from hw.camera.recording import KinectRecording
from hw.poses import inverse
from hw.types import Array, CameraModel, Frame
from perception.cylinder import Cylinder
from perception.geometry import project

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
    """(h, w, 3) RGB: readings of what stands on the table, and the rims of the cylinder fitted to them."""
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
