"""Closed-form solutions: our own for a robust start, and OpenCV's five for comparison.

Ours is Shah's ("Solving the robot-world/hand-eye calibration problem using the Kronecker product", 2013), for many
subsets of views at once. Each random subset gives a calibration, and the one with the best median fit over all views
wins. So the start is sound as long as fewer than half of the views are spoilt. The subsets are drawn with a fixed seed
from sorted views: the same views give the same start.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from calib.geometry import angle_deg, difference, distance_mm, pose
from calib.types import ClosedForm
from hw.poses import inverse
from hw.types import Array

SUBSET = 5
SUBSETS = 200
_LEVER_M = 0.5  # a rotation counts as its arc at this distance


def robust_start(X_AH: Array, X_CM: Array) -> tuple[Array, Array]:
    """(N, 4, 4) each, N >= 4 -> X_AC and X_HM (4, 4)."""
    n = len(X_AH)
    rng = np.random.default_rng(20130101)
    size = min(SUBSET, n)
    chosen = np.stack([np.sort(rng.permutation(n)[:size]) for _ in range(SUBSETS)] if n > size else [np.arange(n)])
    X_AC, X_HM = shah(X_AH[chosen], X_CM[chosen])
    off = difference(inverse(X_AC)[:, None] @ X_AH @ X_HM[:, None], X_CM)
    score = np.linalg.norm(off[..., 3:], axis=-1) + _LEVER_M * np.linalg.norm(off[..., :3], axis=-1)
    half = np.sort(score, axis=1)[:, : n // 2 + 1]
    best = int(np.argmin(half.sum(axis=1)))
    agreeing = np.sort(np.argsort(score[best], kind="stable")[: max(n // 2 + 1, size)])
    X_AC, X_HM = shah(X_AH[agreeing][None], X_CM[agreeing][None])
    return X_AC[0], X_HM[0]


def size_by_motion(X_AH: Array, X_CM: Array) -> float:
    """True size of the target over the size used to find X_CM (N, 4, 4), N >= 4; the median of subsets.

    Rotations do not depend on the size; given them, R_AH p_HM + p_AH = R_AC (s p_CM) + p_AC is linear in the rest.
    """
    n, size = len(X_AH), min(SUBSET + 2, len(X_AH))
    rng = np.random.default_rng(20130102)
    sizes = []
    for _ in range(SUBSETS):
        rows = rng.permutation(n)[:size]
        R_AC = shah(X_AH[rows][None], X_CM[rows][None])[0][0, :3, :3]
        turned = X_CM[rows, :3, 3] @ R_AC.T
        A = np.concatenate(
            [X_AH[rows, :3, :3], np.broadcast_to(-np.eye(3), (size, 3, 3)), -turned[..., None]], axis=2
        ).reshape(3 * size, 7)
        x, _, rank, _ = np.linalg.lstsq(A, -X_AH[rows, :3, 3].ravel(), rcond=1e-9)
        if rank == 7 and x[6] > 0:
            sizes.append(float(x[6]))
    return float(np.median(sizes)) if sizes else 1.0


def shah(X_AH: Array, X_CM: Array) -> tuple[Array, Array]:
    """(S, N, 4, 4) each -> X_AC and X_HM (S, 4, 4), least squares of X_AH X_HM = X_AC X_CM."""
    Ra, Rb = X_AH[..., :3, :3], X_CM[..., :3, :3]
    # sum of kron(Rb, Ra); its leading singular vectors are the two rotations, stacked by column
    K = np.einsum("snij,snkl->sikjl", Rb, Ra).reshape(len(Ra), 9, 9)
    u, _, vt = np.linalg.svd(K)
    first, second = u[:, :, 0], vt[:, 0]
    R_AC, R_HM = _to_rotations(first), _to_rotations(second)
    # Ra p_HM + pa = R_AC pb + p_AC
    n = Ra.shape[1]
    A = np.concatenate([Ra, np.broadcast_to(-np.eye(3), Ra.shape)], axis=-1).reshape(len(Ra), 3 * n, 6)
    pb = np.einsum("sij,snj->sni", R_AC, X_CM[..., :3, 3])
    b = (pb - X_AH[..., :3, 3]).reshape(len(Ra), 3 * n)
    normal = np.einsum("sri,srj->sij", A, A) + 1e-9 * np.eye(6)
    p = np.linalg.solve(normal, np.einsum("sri,sr->si", A, b)[..., None])[..., 0]
    return pose(R_AC, p[:, 3:]), pose(R_HM, p[:, :3])


def _to_rotations(vectors: Array) -> Array:
    """(S, 9) matrices stacked by column, of any sign and size -> (S, 3, 3) nearest rotations."""
    R = np.swapaxes(vectors.reshape(-1, 3, 3), 1, 2)
    u, _, vt = np.linalg.svd(R * np.where(np.linalg.det(R) < 0, -1.0, 1.0)[:, None, None])
    u[..., 2] *= np.linalg.det(u @ vt)[:, None]  # of views that are all alike, nothing follows, but it is a rotation
    nearest: Array = u @ vt
    return nearest


_HAND_EYE = {
    "Tsai": cv2.CALIB_HAND_EYE_TSAI,
    "Park": cv2.CALIB_HAND_EYE_PARK,
    "Daniilidis": cv2.CALIB_HAND_EYE_DANIILIDIS,
}
_ROBOT_WORLD = {"Shah": cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH, "Li": cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI}


def opencv_methods(X_AH: Array, X_CM: Array) -> dict[str, Array]:
    """OpenCV's methods on the same views (N, 4, 4) -> X_AC by name, without methods that fail."""
    # OpenCV solves for a camera on a gripper; a camera fixed in A is one on a "gripper" whose pose in H is known
    X_HA = inverse(X_AH)
    R_HA, p_HA = list(X_HA[:, :3, :3]), list(X_HA[:, :3, 3])
    R_CM, p_CM = list(X_CM[:, :3, :3]), list(X_CM[:, :3, 3])
    out: dict[str, Array] = {}
    for name, method in _HAND_EYE.items():
        try:
            R, p = cv2.calibrateHandEye(R_HA, p_HA, R_CM, p_CM, method=method)
        except cv2.error:
            continue
        out[name] = pose(R, np.ravel(p))
    for name, method in _ROBOT_WORLD.items():
        # with world = board, base = H, gripper = A it returns the base in the world and the camera in the gripper,
        # inverted
        try:
            _, _, R, p = cv2.calibrateRobotWorldHandEye(
                R_CM, p_CM, list(X_AH[:, :3, :3]), list(X_AH[:, :3, 3]), method=method
            )
        except cv2.error:
            continue
        out[name] = inverse(pose(R, np.ravel(p)))
    return {name: X for name, X in out.items() if np.isfinite(X).all() and np.linalg.det(X[:3, :3]) > 0.5}


def cross_check(X_AH: Array, X_CM: Array, X_AC: Array) -> tuple[ClosedForm, ...]:
    """The closed forms, compared with the solution `X_AC`."""
    poses = opencv_methods(X_AH, X_CM)
    return tuple(
        ClosedForm(name=name, from_solution_mm=distance_mm(X, X_AC), from_solution_deg=angle_deg(X, X_AC))
        for name, X in poses.items()
    )


def disagreement_mm(methods: Sequence[ClosedForm]) -> float:
    """Median distance of the closed forms from the solution; inf if there are none."""
    return float(np.median([m.from_solution_mm for m in methods])) if methods else float("inf")
