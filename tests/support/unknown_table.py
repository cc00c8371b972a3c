"""The table as a depth camera sees it, found without any calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.types import Array
from perception.errors import TableNotFound

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

    Random triples (Fischler and Bolles, 1981), then least squares over what lies within `near_m`.
    Raises TableNotFound when no such plane holds a fiftieth of the points.
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
