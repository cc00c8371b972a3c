"""Hand and flange as a camera sees them, against the maker's meshes (as franky-sim ships them)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import franky_sim
import numpy as np
import pytest

from hw.collision import ARM, HAND, Capsule, segments
from hw.kinematics import FLANGE, link_poses
from hw.types import Array
from hw.wrist import FINGERTIP_M, SEEN, X_FH

MESHES = Path(franky_sim.__file__).parent / "assets" / "meshes"
MASK_SLACK_M = 0.025
FINGER_JOINT_M = 0.0584


@cache
def vertices(name: str) -> Array:
    """(V, 3) every fifth vertex of the meshes of a link, in its frame."""
    lines = [line for path in sorted(MESHES.glob(f"{name}_*vis.obj")) for line in path.read_text().splitlines()]
    return np.array([[float(v) for v in line.split()[1:4]] for line in lines if line.startswith("v ")])[::5]


def outside_m(points_m: Array, capsules: tuple[Capsule, ...], poses: Array) -> float:
    """How far the farthest of the points (V, 3) in the base lies outside of all capsules."""
    gaps = []
    for (start, end), capsule in zip(segments(poses, capsules), capsules, strict=True):
        axis = end - start
        along = np.clip((points_m - start) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
        gaps.append(np.linalg.norm(points_m - start - along[:, None] * axis, axis=1) - capsule.radius_m)
    return float(np.min(gaps, axis=0).max())


def placed(name: str, poses: Array) -> Array:
    if name in ("hand", "finger"):
        off = np.array([0.0, 0.0, FINGER_JOINT_M if name == "finger" else 0.0])
        X = poses[FLANGE] @ X_FH
        return (vertices(name) + off) @ X[:3, :3].T + X[:3, 3]
    X = poses[int(name[-1])]
    return vertices(name) @ X[:3, :3].T + X[:3, 3]


@pytest.fixture(params=range(3))
def poses(request: pytest.FixtureRequest) -> Iterator[Array]:
    q_rad = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.785])
    yield link_poses(q_rad + np.random.default_rng(request.param).uniform(-0.5, 0.5, 7))


@pytest.mark.parametrize("name", ["hand", "finger", *(f"link{n}" for n in range(1, 8))])
def test_the_mask_holds_every_point_of_the_makers_meshes(name: str, poses: Array) -> None:
    assert outside_m(placed(name, poses), SEEN, poses) < MASK_SLACK_M


@pytest.mark.parametrize("name", ["hand", "link7"])
def test_the_makers_coarse_capsules_alone_do_not(name: str, poses: Array) -> None:
    assert outside_m(placed(name, poses), (*ARM, *HAND), poses) > MASK_SLACK_M


def test_the_fingers_end_where_their_mesh_ends() -> None:
    assert vertices("finger")[:, 2].max() + FINGER_JOINT_M == pytest.approx(FINGERTIP_M, abs=2e-4)
