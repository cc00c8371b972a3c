"""Cylinders on a table that nobody calibrated: the table is found first, then what stands on it is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from unknown_table import Plane, find_plane, table_frame

from hw.poses import inverse
from hw.types import Array, CameraModel, Frame
from perception.arm_mask import NO_ARM
from perception.clutter import Thing, things
from perception.cylinder import Circle, fit_circle
from perception.errors import ObjectNotFound
from perception.geometry import ImageRegion
from perception.scan import Scan

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
    """The table below what the depth camera sees within `most_m`, and the largest cylinder that stands on it.

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
    found = [_standing(scan, thing) for thing in things(scan, near, NO_ARM)]
    good = [s for s in found if s is not None and s.circle.rms_m < _LARGEST_RMS_M]
    if not good:
        raise ObjectNotFound(f"none of the {len(found)} things on the table is a cylinder; show it from the side")
    largest = max(good, key=lambda s: len(s.thing.points_m))
    return Survey(table, X_BD @ inverse(model.X_CD), largest)


def _standing(scan: Scan, thing: Thing) -> Standing | None:
    """The upright cylinder through a thing's side; None when too little of a side is seen."""
    height = thing.points_m[:, 2]
    side = thing.points_m[(height > 2 * _RIM_M) & (height < thing.height_m - _RIM_M), :2]
    if len(side) < _FEWEST:
        return None
    middle = np.median(side, axis=0)
    away = (middle - scan.view.X_BV[:2, 3]) / np.linalg.norm(middle - scan.view.X_BV[:2, 3])
    circle = fit_circle(side, middle + 2 / np.pi * _RADIUS_M * away, _RADIUS_M, _RADIUS_STD_M)
    return Standing(circle, thing.height_m, thing)
