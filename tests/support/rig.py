"""A Panda in front of a Kinect, by its corners alone."""

from __future__ import annotations

import numpy as np
from simulated_views import Quality, Truth, example_setup, example_truth, random_poses, seen

from calib.types import Mounting, Setup, View
from hw.joint_limits import LIMITS
from hw.kinematics import forward
from hw.types import Array

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
