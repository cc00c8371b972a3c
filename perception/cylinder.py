"""Fit a cylinder to points of its visible side: upright with known or unknown radius, or in any pose.

Least squares with Tukey's weights. Points of an object that touches the cylinder, and points at edges where a depth
camera mixes two surfaces, get no weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from hw.poses import translation
from hw.types import Array

_LEVELS = np.array([-0.5, 0.0, 0.5])
_WIDE_M, _NARROW_M = 0.016, 0.006  # distance at which a point gets no weight: first and last iteration
_STEPS = 16
_POINT_STD_M = 0.002
_LONGEST_STEP_M, _LONGEST_TURN_RAD = 0.02, 0.25


@dataclass(frozen=True)
class Cylinder:
    """A solid of revolution about the Z axis of its frame O, with the origin at its centre."""

    radius_m: float
    height_m: float

    @cached_property
    def rims_m(self) -> Array:
        """(72, 3) points around its top, its middle and its bottom, in O."""
        turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        ring = self.radius_m * np.column_stack([np.cos(turn), np.sin(turn)])
        return np.concatenate([np.column_stack([ring, np.full(24, z)]) for z in self.height_m * _LEVELS])

    def upright(self, xy_m: Array) -> Array:
        """X_BO (4, 4) standing on the table at `xy_m` (2,)."""
        return translation([xy_m[0], xy_m[1], self.height_m / 2])


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle through points seen from above."""

    centre_m: Array  # (2,)
    radius_m: float
    rms_m: float  # of the points with weight
    share: float  # of the points with weight


def fit_circle(xy_m: Array, start_m: Array, radius_m: float, radius_std_m: float = 0.0) -> Circle:
    """The circle near `start_m` (2,) through (n, 2) points, n at least 3.

    The radius is `radius_m` with a standard deviation of `radius_std_m`; with 0 it is exact.
    """
    x = np.array([*start_m, radius_m])
    free = 3 if radius_std_m > 0 else 2
    off = weight = np.zeros(len(xy_m))
    for i in range(_STEPS):
        gate_m = max(_NARROW_M, _WIDE_M * 0.75**i)
        arm = xy_m - x[:2]
        distance = np.maximum(np.sqrt(np.einsum("ni,ni->n", arm, arm)), 1e-9)
        off = distance - x[2]
        weight = _tukey(off, gate_m)
        J = np.column_stack([-arm / distance[:, None], -np.ones(len(arm))])[:, :free]
        A = (J * weight[:, None]).T @ J + 1e-6 * np.eye(free)
        b = -(J * weight[:, None]).T @ off
        if free == 3:
            belief = (_POINT_STD_M / radius_std_m) ** 2
            A[2, 2] += belief
            b[2] += belief * (radius_m - x[2])
        step = np.linalg.solve(A, b)
        step *= min(1.0, _LONGEST_STEP_M / max(float(np.linalg.norm(step)), 1e-12))
        x[:free] += step
        if gate_m == _NARROW_M and np.abs(step).max() < 1e-5:
            break
    counts = weight > 0
    rms_m = float(np.sqrt(np.mean(off[counts] ** 2))) if counts.any() else np.inf
    return Circle(x[:2], float(x[2]), rms_m, float(counts.mean()))


def fit_pose(points_m: Array, X_BO: Array, body: Cylinder) -> Array:
    """X_BO (4, 4) near the given one, upright or not, that puts the surface of `body` through (n, 3) points."""
    X = X_BO.copy()
    half = body.height_m / 2
    for i in range(_STEPS):
        arm = points_m - X[:3, 3]
        local = arm @ X[:3, :3]
        off, normal = _surface(local, body.radius_m, half)
        normal = normal @ X[:3, :3].T
        weight = _tukey(off, max(2 * _NARROW_M, 2 * _WIDE_M * 0.75**i))
        J = -np.column_stack([normal, _cross(arm, normal)])
        damping = np.diag([1e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-4])
        step = np.linalg.solve((J * weight[:, None]).T @ J + damping, -(J * weight[:, None]).T @ off)
        step[:3] *= min(1.0, _LONGEST_STEP_M / max(float(np.linalg.norm(step[:3])), 1e-12))
        step[3:] *= min(1.0, _LONGEST_TURN_RAD / max(float(np.linalg.norm(step[3:])), 1e-12))
        X[:3, 3] += step[:3]
        X[:3, :3] = cv2.Rodrigues(step[3:])[0] @ X[:3, :3]
        if np.abs(step).max() < 1e-4 and i > 4:
            break
    return X


def distance_m(points_m: Array, X_BO: Array, body: Cylinder) -> Array:
    """(n,) signed distances of (n, 3) points to the surface, negative inside."""
    local = (points_m - X_BO[:3, 3]) @ X_BO[:3, :3]
    return _surface(local, body.radius_m, body.height_m / 2)[0]


def front_m(along: Array, eye_m: Array, X_BO: Array, body: Cylinder) -> Array:
    """(n,) where rays eye + t along, t from 0, first meet the surface; inf where they miss. `along` is (n, 3)."""
    size = np.array([body.radius_m, body.radius_m, body.height_m / 2])
    origin = (eye_m - X_BO[:3, 3]) @ X_BO[:3, :3] / size
    ray = along @ X_BO[:3, :3] / size
    a = np.maximum(ray[:, 0] ** 2 + ray[:, 1] ** 2, 1e-18)
    b = ray[:, 0] * origin[0] + ray[:, 1] * origin[1]
    root = b * b - a * (origin[0] ** 2 + origin[1] ** 2 - 1)
    half = np.sqrt(np.maximum(root, 0))
    through = np.where(np.abs(ray[:, 2]) > 1e-12, ray[:, 2], 1e-12)
    one, other = (-1 - origin[2]) / through, (1 - origin[2]) / through
    enter = np.maximum((-b - half) / a, np.minimum(one, other))
    hit = (root > 0) & (enter > 0) & (enter < np.minimum((-b + half) / a, np.maximum(one, other)))
    return np.where(hit, enter, np.inf)


def lowest_m(X_BO: Array, body: Cylinder) -> float:
    """Height of its lowest point over the table."""
    upright = abs(float(X_BO[2, 2]))
    level = float(np.sqrt(max(1 - upright**2, 0.0)))
    return float(X_BO[2, 3]) - body.height_m / 2 * upright - body.radius_m * level


def tilt_rad(X_BO: Array) -> float:
    """Angle between the axis and the vertical, 0 ... pi / 2."""
    return float(np.arccos(np.clip(abs(X_BO[2, 2]), 0.0, 1.0)))


def _cross(a: Array, b: Array) -> Array:
    """`numpy.cross` for (n, 3), in a third of the time."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.column_stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _tukey(off: Array, gate_m: float) -> Array:
    weight: Array = np.maximum(1 - (off / gate_m) ** 2, 0) ** 2
    return weight


def _surface(local: Array, radius_m: float, half_m: float) -> tuple[Array, Array]:
    """Signed distance (n,) and outward normal (n, 3) of the closed cylinder at points of its own frame."""
    rho = np.maximum(np.hypot(local[:, 0], local[:, 1]), 1e-9)
    side, cap = rho - radius_m, np.abs(local[:, 2]) - half_m
    out_side, out_cap = np.maximum(side, 0), np.maximum(cap, 0)
    outside = np.hypot(out_side, out_cap)
    beyond = outside > 0
    on_side = np.where(beyond, out_side / np.maximum(outside, 1e-12), side >= cap)
    on_cap = np.where(beyond, out_cap / np.maximum(outside, 1e-12), side < cap)
    normal = np.column_stack([on_side[:, None] * local[:, :2] / rho[:, None], on_cap * np.sign(local[:, 2])])
    return np.where(beyond, outside, np.maximum(side, cap)), normal
