"""Views as a camera and an arm of stated quality would give them, without rendering.

Of a Panda in front of a Kinect: for choosing poses, for the factors in `uncertainty.py`, for tests and for
`benchmarks/calibration.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib.geometry import move
from calib.projection import project
from calib.types import Forward, Mounting, Setup, View
from hw.joint_limits import LIMITS
from hw.kinematics import forward
from hw.poses import inverse, pose, translation
from hw.types import Array, Intrinsics
from perception.board.types import Board, Corners


@dataclass(frozen=True, eq=False)
class Truth:
    """What a calibration is to find."""

    X_AC: Array
    X_HM: Array
    offsets_rad: Array = field(default_factory=lambda: np.zeros(7))
    board_scale: float = 1.0  # the print is larger than stated by this


@dataclass(frozen=True)
class Quality:
    """Standard deviations of normal errors."""

    corner_px: float = 0.2
    joint_rad: float = 0.0  # from view to view


def visible(setup: Setup, X_CM: Array, distance_m: tuple[float, float], max_tilt_deg: float) -> NDArray[np.bool_]:
    """(N,) is the whole board in the image, its face towards the camera, near enough and not too oblique?"""
    outline = np.broadcast_to(setup.board.outline_m, (len(X_CM), 4, 3))
    local = outline @ np.swapaxes(X_CM[:, :3, :3], 1, 2) + X_CM[:, None, :3, 3]
    centre = local.mean(axis=1)
    distance = np.linalg.norm(centre, axis=1)
    facing = np.einsum("ni,ni->n", X_CM[:, :3, 2], centre) / distance
    ok = (local[..., 2] > 0.1).all(axis=1) & (distance > distance_m[0]) & (distance < distance_m[1])
    ok &= facing > np.cos(np.deg2rad(max_tilt_deg))
    uv = project(setup.colour, np.where(ok[:, None, None], X_CM, _in_front()), outline)
    limit = np.array([setup.colour.width, setup.colour.height]) - 6.0
    return np.asarray(ok & ((uv > 5.0) & (uv < limit)).all(axis=(1, 2)))


def _in_front() -> Array:
    return translation([0.0, 0.0, 1.0])


def seen(
    setup: Setup, truth: Truth, forward: Forward, q_rad: Array, quality: Quality, rng: np.random.Generator
) -> list[View]:
    """(N, n) reported joints -> views in that order, named "view-000" and on."""
    actual = q_rad + truth.offsets_rad + quality.joint_rad * rng.standard_normal(q_rad.shape)
    X_CM = board_in_camera(setup.mounting, truth, forward(actual))
    p = np.broadcast_to(truth.board_scale * setup.board.p_MK_m, (len(X_CM), setup.board.corners, 3))
    px = project(setup.colour, X_CM, p) + quality.corner_px * rng.standard_normal((*p.shape[:2], 2))
    ids = np.arange(setup.board.corners)
    views = []
    for i, (q, uv) in enumerate(zip(q_rad, px, strict=True)):
        inside = ((uv > 3.0) & (uv < [setup.colour.width - 4.0, setup.colour.height - 4.0])).all(axis=1)
        views.append(View(f"view-{i:03d}", Corners(ids[inside], uv[inside]), q_rad=q))
    return views


def board_in_camera(mounting: Mounting, truth: Truth, X_BF: Array) -> Array:
    """(N, 4, 4) -> X_CM (N, 4, 4)."""
    X_AH = X_BF if mounting is Mounting.FIXED else inverse(X_BF)
    X_CM: Array = inverse(truth.X_AC) @ X_AH @ truth.X_HM
    return X_CM


def spoilt(views: Sequence[View], which: Sequence[int], forward: Forward, rng: np.random.Generator) -> list[View]:
    """The same views with the joints of some exchanged for others: the arm moved, or an image mispaired.

    The flange is off by 10 to 60 mm or 1 to 8 degrees, or both.
    """
    out = list(views)
    for i in which:
        view = views[i]
        assert view.q_rad is not None
        here = forward(view.q_rad)
        while True:
            q = view.q_rad + rng.normal(0.0, 0.06, len(view.q_rad))
            there = forward(q)
            shift = float(np.linalg.norm(there[:3, 3] - here[:3, 3]))
            if 0.010 < shift < 0.060:
                break
        out[i] = View(view.name, view.corners, q_rad=q)
    return out


KINECT = Intrinsics(
    1280,
    720,
    np.array([[611.8, 0, 639.3], [0, 611.9, 365.9], [0, 0, 1]]),
    np.array([0.33012, -2.48940, -0.00016, -0.00013, 1.45367, 0.20891, -2.30292, 1.37513]),
)
"""Colour camera of an Azure Kinect at 720p: the factory figures of one device, rounded."""


def example_setup(mounting: Mounting = Mounting.FIXED) -> Setup:
    """A Kinect and the default board."""
    return Setup(mounting, Board(), KINECT)


def example_truth(rng: np.random.Generator) -> Truth:
    """A camera opposite the arm, looking down at it, and a board on the flange, face outwards."""
    eye, target = np.array([1.45, 0.0, 0.75]), np.array([0.5, 0.0, 0.35])
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    X_BC = pose(np.stack([x, np.cross(z, x), z], axis=1), eye)
    X_FM = np.eye(4)
    X_FM[:3, :3] = np.diag([1.0, -1.0, -1.0])  # Z of the board into the paper, towards the flange
    X_FM[:3, 3] = -X_FM[:3, :3] @ np.array([0.14, 0.10, 0.0]) + [0.0, 0.0, 0.02]
    spread = np.array([0.05, 0.05, 0.05, 0.03, 0.03, 0.03])
    return Truth(move(X_BC, spread * rng.standard_normal(6)), move(X_FM, 0.2 * spread * rng.standard_normal(6)))


def random_poses(
    setup: Setup,
    truth: Truth,
    forward: Forward,
    q_bounds_rad: tuple[Array, Array],
    count: int,
    rng: np.random.Generator,
    distance_m: tuple[float, float] = (0.7, 1.3),
    max_tilt_deg: float = 45.0,
) -> Array:
    """(count, n) random joints at which the camera sees the whole board."""
    low, high = q_bounds_rad
    kept: list[Array] = []
    for _ in range(400):
        q = rng.uniform(low, high, (4000, len(low)))
        ok = visible(setup, board_in_camera(setup.mounting, truth, forward(q)), distance_m, max_tilt_deg)
        kept.append(q[ok])
        if sum(map(len, kept)) >= count:
            break
    return np.concatenate(kept)[:count]


def work_error_mm(X_AC: Array, X_AC_true: Array, points_m: Array) -> Array:
    """(P,) how far points (P, 3) of A are seen from where they are, with a wrong camera pose."""
    local = (points_m - X_AC_true[:3, 3]) @ X_AC_true[:3, :3]
    off: Array = 1e3 * np.linalg.norm(local @ X_AC[:3, :3].T + X_AC[:3, 3] - points_m, axis=1)
    return off


BOUNDS = (0.9 * LIMITS["panda"].q_min_rad, 0.9 * LIMITS["panda"].q_max_rad)
SETUP = example_setup()
OFFSETS_RAD = np.array([0.0, 1.5e-3, -1.0e-3, 2.0e-3, 0.8e-3, -1.2e-3, 0.0])


def truth(seed: int = 0, offsets_rad: Array | None = None, board_scale: float = 1.0) -> Truth:
    eye = example_truth(np.random.default_rng(seed))
    return Truth(eye.X_AC, eye.X_HM, np.zeros(7) if offsets_rad is None else offsets_rad, board_scale)


def views(
    true: Truth,
    count: int = 20,
    seed: int = 0,
    quality: Quality | None = None,
    setup: Setup = SETUP,
    distance_m: tuple[float, float] = (0.7, 1.3),
) -> list[View]:
    rng = np.random.default_rng([seed, 1])
    q = random_poses(setup, true, forward, BOUNDS, count, rng, distance_m)
    assert len(q) == count
    return seen(setup, true, forward, q, Quality(0.1) if quality is None else quality, rng)


def wrist() -> tuple[Setup, Truth]:
    """The camera on the flange, looking along its Z; the board on the table."""
    X_FC = np.eye(4)
    X_FC[:3, 3] = 0.05, -0.03, 0.06
    X_BM = np.eye(4)
    X_BM[:3, :3] = np.diag([1.0, -1.0, -1.0])  # face up
    X_BM[:3, 3] = 0.36, 0.10, 0.0
    return example_setup(Mounting.WRIST), Truth(X_FC, X_BM)
