"""Where a cylinder of known size stands, leans or lies in one depth image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import cv2
import numpy as np

from hw.poses import pose
from hw.types import Array
from perception.arm_mask import ArmShape
from perception.cylinder import Cylinder, fit_circle, fit_pose, front_m, lowest_m, tilt_rad
from perception.geometry import Array32, ImageRegion, project
from perception.scan import Raw, Scan

ABOVE_M = 0.012
"""Readings lower than this (m) count as table."""
ENOUGH_READ = 0.5
"""Smallest share of a face with readings: a dark, shiny or printed face gives few."""
_REACH_M = 0.13  # radius of the search around the expected place
_TOP_M = 0.008  # readings this near to its full height are its top
_FEWEST = 30
_AGREES_M = 0.008
_WELL, _BADLY = 0.80, 0.60
_LEANS_DEG = 2.5  # less than this is within the error of a fitted tilt
_SAME = 0.01  # of confidence
_FALLING_DEG, _SURE = 20.0, 0.92
_OFF_TABLE_M = 0.015  # a body that floats, or sinks into the table, by this much is not a bottle
_ENOUGH = 400  # points for a fit
_CLEAR_SHARE = 0.75  # of the points on one circle: no other circle needs to be searched
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)


@dataclass(frozen=True, eq=False)
class BottleFix:
    """An estimate for one frame, and how far the picture supports it."""

    X_BO: Array  # (4, 4), Z along the axis
    in_picture: float  # share of it that lies inside the camera's image
    read: float  # share of its face with readings
    visible: float  # share of its face in the picture that is not hidden; lowered if under half of it is read
    fit: float  # 0 ... 1, agreement of the readings there with it

    @property
    def centre_m(self) -> Array:
        """(3,) in the base frame."""
        return np.asarray(self.X_BO[:3, 3])

    @property
    def tilt_deg(self) -> float:
        """The angle from upright."""
        return float(np.rad2deg(tilt_rad(self.X_BO)))

    @property
    def confidence(self) -> float:
        """0 to 1: low for a hidden or badly fitting body."""
        return self.visible * self.fit

    @classmethod
    def better(cls, places: list[Self]) -> Self:
        """The place with the highest confidence."""
        return max(places, key=lambda place: place.confidence)


@dataclass(frozen=True, eq=False)
class Patch:
    """The depth readings around one place."""

    view: ImageRegion
    depth_m: Array32  # (h, w) 0 where there is no reading
    along: Array32  # (h, w, 3) how a point moves with its depth
    points_m: Array  # (n, 3) above the table, without the arm

    @property
    def eye_m(self) -> Array:
        """(3,) the camera."""
        return np.asarray(self.view.X_BV[:3, 3])


def patch(scan: Scan, raw: Raw, centre_m: Array, arm: ArmShape) -> Patch | None:
    """The surroundings of `centre_m` (3,); None outside the picture."""
    view = scan.view.window(centre_m, _REACH_M)
    if view is None:
        return None
    part = scan.rectangle(view)
    depth, along = scan.depth(raw[part]), scan.along[part]
    above = (depth > 0) & (scan.heights(depth, part) > ABOVE_M)
    points = scan.points(depth, above, part)
    away = points - centre_m
    points = points[np.einsum("ni,ni->n", away, away) < _REACH_M**2]
    return Patch(view, depth, along, points[~arm.holds(points)])


def locate_body(surface: Patch, body: Cylinder, guess: Array) -> BottleFix | None:
    """The body near X_BO `guess` (4, 4): upright if that explains the readings, else as it leans or lies."""
    if len(surface.points_m) < _FEWEST:
        return None
    few = surface.points_m[:: max(1, len(surface.points_m) // _ENOUGH)]
    if np.rad2deg(tilt_rad(guess)) > _FALLING_DEG:  # it keeps falling, or lies
        again = fit_pose(few, guess, body)
        fallen = appraise(surface, body, again)
        if _leans(again, body) and fallen.confidence > _SURE:
            return fallen
    standing = [appraise(surface, body, X) for X in _standing(surface, body, guess)]
    best = BottleFix.better(standing) if standing else None
    starts = [best.X_BO] if best is not None and best.fit >= _WELL else [guess, *(p.X_BO for p in standing)]
    leaning = [appraise(surface, body, X) for X in (fit_pose(few, X, body) for X in starts) if _leans(X, body)]
    if best is None or (leaning and BottleFix.better(leaning).confidence > best.confidence - _SAME):
        best = BottleFix.better(leaning) if leaning else None
    if best is None or best.fit < _BADLY:
        fits = (fit_pose(few, X, body) for X in _lying(surface, body))
        lying = [appraise(surface, body, X) for X in fits if _leans(X, body)]
        best = BottleFix.better([p for p in (best, *lying) if p is not None]) if lying or best else None
    return best


def _leans(X_BO: Array, body: Cylinder) -> bool:
    """Whether it is not upright, and on the table."""
    return bool(np.rad2deg(tilt_rad(X_BO)) > _LEANS_DEG and abs(lowest_m(X_BO, body)) < _OFF_TABLE_M)


def appraise(surface: Patch, body: Cylinder, X_BO: Array) -> BottleFix:
    """How well the body at X_BO agrees with the readings."""
    camera = surface.view.camera
    uv = project(camera, surface.view.X_VB, body.rims_m @ X_BO[:3, :3].T + X_BO[:3, 3])
    inside = float(((uv > 1) & (uv < np.array([camera.width, camera.height]) - 2)).all(axis=1).mean())
    nothing = BottleFix(X_BO, inside, 0.0, 0.0, 0.0)
    corner = np.array([surface.view.columns.start, surface.view.rows.start])
    low, high = (np.clip(x - corner, 0, surface.depth_m.shape[::-1]) for x in (uv.min(axis=0) - 1, uv.max(axis=0) + 2))
    box = np.s_[int(low[1]) : int(high[1]), int(low[0]) : int(high[0])]
    measured, along = surface.depth_m[box], surface.along[box]
    if measured.size == 0:
        return nothing
    front = front_m(along.reshape(-1, 3).astype(np.float64), surface.eye_m, X_BO, body).reshape(measured.shape)
    # readings at its rim may mix with the background: a rim of one pixel is left out
    face = cv2.erode(np.isfinite(front).astype(np.uint8), _CROSS, borderValue=0) > 0
    read = face & (measured > 0)
    off = (measured - np.where(read, front, 0))[read]
    agree, deeper = int((np.abs(off) < _AGREES_M).sum()), int((off >= _AGREES_M).sum())
    if agree == 0:
        return nothing
    hidden = 1 - (agree + deeper) / len(off)
    share = len(off) / int(face.sum())
    readability = min(1.0, share / ENOUGH_READ)
    return BottleFix(X_BO, inside, share, readability * (1 - hidden) * inside, agree / (agree + deeper))


def _standing(surface: Patch, body: Cylinder, guess: Array) -> list[Array]:
    """Upright poses: at its visible top, at the expected place, or behind the middle of its visible side."""
    points = surface.points_m
    height = points[:, 2]
    side = points[height < body.height_m - _TOP_M, :2]
    if len(side) < _FEWEST:
        return []
    top = points[np.abs(height - body.height_m) < _TOP_M, :2]
    middle = np.median(side, axis=0)
    away = (middle - surface.eye_m[:2]) / max(float(np.linalg.norm(middle - surface.eye_m[:2])), 1e-9)
    starts = [guess[:2, 3], middle + 2 / np.pi * body.radius_m * away]
    if len(top) >= _FEWEST:
        starts.insert(0, np.median(top, axis=0))
    few = side[:: max(1, len(side) // _ENOUGH)]
    centres: list[Array] = []
    for start in starts:
        circle = fit_circle(few, start, body.radius_m)
        if all(np.linalg.norm(circle.centre_m - other) > 0.001 for other in centres):
            centres.append(circle.centre_m)
        if circle.share > _CLEAR_SHARE:
            break
    return [body.upright(xy) for xy in centres]


def _lying(surface: Patch, body: Cylinder) -> list[Array]:
    """Poses on its side: along the longest direction of the points, and across it."""
    low = surface.points_m[surface.points_m[:, 2] < 3 * body.radius_m]
    if len(low) < _FEWEST:
        return []
    middle = np.median(low[:, :2], axis=0)
    _, axes = np.linalg.eigh(np.cov((low[:, :2] - middle).T))
    poses = []
    for x, y in axes.T:
        R = np.column_stack([[0.0, 0.0, 1.0], [y, -x, 0.0], [x, y, 0.0]])
        poses.append(pose(R, [*middle, body.radius_m]))
    return poses
