"""The maker's meshes are read into the right frames: where links meet, their surfaces meet."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from arm_meshes import bodies, placed
from own_judge import AT_ZERO, poses
from scipy.spatial import cKDTree


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_neighbouring_links_meet_around_their_joint(model: str) -> None:
    X_BL = poses(np.zeros((1, 7)))[0]
    assert np.allclose(X_BL[:, :3, 3], [origin for _, origin in AT_ZERO])
    links = bodies(model)[:9]
    surfaces = [placed(body.points_m(0.01), X_BL[body.link]) for body in links]
    for before, after in pairwise(surfaces):
        gap = cKDTree(before).query(after)[0].min()
        assert gap < 0.012, "two meshes of a joint touch, up to the spacing of their points"


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_the_points_hold_every_corner_and_no_gap(model: str) -> None:
    hand = bodies(model)[8]
    points = hand.points_m(0.004)
    rng = np.random.default_rng(0)
    share = rng.dirichlet(np.ones(3), size=len(hand.triangles_m))
    drawn = np.einsum("tc,tcx->tx", share, hand.triangles_m)
    for asked, within_m in ((hand.triangles_m.reshape(-1, 3), 1e-6), (drawn, 0.004)):
        assert cKDTree(points).query(asked)[0].max() < within_m


def test_the_fingers_open_along_the_hand() -> None:
    closed, open_ = (np.concatenate([b.points_m(0.01) for b in bodies("fr3", m)[9:]]) for m in (0.0, 0.08))
    along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)  # Y of the hand in the flange
    assert np.abs(closed @ along).max() == pytest.approx(0.0262, abs=1e-3)
    assert np.abs(open_ @ along).max() == pytest.approx(0.0662, abs=1e-3)
    assert np.ptp(open_ @ [1.0, -1.0, 0.0]) / np.sqrt(2.0) == pytest.approx(0.022, abs=1e-6)
