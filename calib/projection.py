"""Pinhole projection with OpenCV's rational distortion, for many boards at once, with derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.geometry import cross_matrix
from hw.types import Array, Intrinsics


def project(camera: Intrinsics, X_CM: Array, p_M_m: Array) -> Array:
    """Poses (N, 4, 4) and points (N, K, 3) of the board -> (N, K, 2) pixels."""
    p = p_M_m @ np.swapaxes(X_CM[:, :3, :3], 1, 2) + X_CM[:, None, :3, 3]
    uv, _ = _distorted(camera, p[..., :2] / p[..., 2:])
    return uv


def project_with_jacobian(camera: Intrinsics, X_CM: Array, p_M_m: Array) -> tuple[Array, Array]:
    """Also the derivative (N, K, 2, 6) of a pixel by a twist of the pose in the board's axes (`geometry.move`)."""
    R = X_CM[:, :3, :3]
    p = p_M_m @ np.swapaxes(R, 1, 2) + X_CM[:, None, :3, 3]
    xy, z = p[..., :2] / p[..., 2:], p[..., 2]
    uv, duv_dxy = _distorted(camera, xy)
    dxy_dp = np.zeros((*z.shape, 2, 3))
    dxy_dp[..., 0, 0] = dxy_dp[..., 1, 1] = 1.0 / z
    dxy_dp[..., :, 2] = -xy / z[..., None]
    duv_dv = duv_dxy @ dxy_dp @ R[:, None]  # with the board's own axes
    return uv, np.concatenate([-duv_dv @ cross_matrix(p_M_m), duv_dv], axis=-1)


def _distorted(camera: Intrinsics, xy: Array) -> tuple[Array, Array]:
    """Normalised (..., 2) -> pixels (..., 2) and their derivative (..., 2, 2)."""
    k1, k2, p1, p2, k3, k4, k5, k6 = camera.distortion
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    above, below = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = above / below
    # d radial / d r2
    slope = (k1 + r2 * (2 * k2 + 3 * r2 * k3) - radial * (k4 + r2 * (2 * k5 + 3 * r2 * k6))) / below
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    J = np.empty((*xy.shape, 2))
    J[..., 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    J[..., 0, 1] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    J[..., 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    J[..., 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    A = camera.K[:2, :2]
    uv: Array = np.stack([u, v], axis=-1) @ A.T + camera.K[:2, 2]
    return uv, A @ J


LENS = 5
"""Number of free lens parameters: log of the focal length, centre u and v in px, k1, k2; all as changes."""


def with_lens(camera: Intrinsics, lens: Array) -> Intrinsics:
    """The camera with its lens changed by (LENS,)."""
    K, distortion = camera.K.copy(), camera.distortion.copy()
    K[[0, 1], [0, 1]] *= np.exp(lens[0])
    K[:2, 2] += lens[1:3]
    distortion[:2] += lens[3:]
    return replace(camera, K=K, distortion=distortion)


def lens_jacobian(camera: Intrinsics, X_CM: Array, p_M_m: Array) -> Array:
    """Poses (N, 4, 4) and points (N, K, 3) -> (N, K, 2, LENS) derivative of a pixel by the lens parameters."""
    p = p_M_m @ np.swapaxes(X_CM[:, :3, :3], 1, 2) + X_CM[:, None, :3, 3]
    xy = p[..., :2] / p[..., 2:]
    uv, _ = _distorted(camera, xy)
    r2 = np.sum(xy**2, axis=-1)
    below = 1 + r2 * (camera.distortion[5] + r2 * (camera.distortion[6] + r2 * camera.distortion[7]))
    J = np.zeros((*xy.shape, LENS))
    J[..., 0] = uv - camera.K[:2, 2]
    J[..., 0, 1] = J[..., 1, 2] = 1.0
    outwards = (xy @ camera.K[:2, :2].T) / below[..., None]
    J[..., 3] = outwards * r2[..., None]
    J[..., 4] = outwards * (r2**2)[..., None]
    return J
