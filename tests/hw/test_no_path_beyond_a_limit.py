"""Random and adversarial paths against an arm that counts: none beyond a limit may reach its driver.

What is beyond a limit is judged by code of its own (`tests/support/own_judge.py`): kinematics, torques, distances and
the maker's numbers. Every accepted path is also stopped, and the stop judged.
"""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import campaign
from hard_paths import LOADED, hunt
from own_judge import AT_ZERO, poses, torques

from hw.dynamics import LINKS, torque_Nm
from hw.kinematics import link_poses


def test_the_judge_and_the_program_place_the_links_alike() -> None:
    q = np.random.default_rng(3).uniform(-2.8, 2.8, (200, 7))
    np.testing.assert_allclose(poses(q), link_poses(q), atol=1e-9)
    assert len(AT_ZERO) == 9


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_the_judge_and_the_program_find_the_same_torques(model: str) -> None:
    t = np.arange(400) / 1e3
    amplitude, pace = np.array([0.3, 0.2, 0.3, 0.3, 0.4, 0.3, 0.5]), np.array([5.0, 6.0, 4.0, 7.0, 8.0, 6.0, 9.0])
    q = np.array([0.1, -0.6, 0.2, -2.1, 0.3, 1.7, 0.4]) + amplitude * np.sin(t[:, None] * pace)
    dq, ddq = (q[2:] - q[:-2]) / 2e-3, np.diff(q, 2, axis=0) * 1e6
    ours = torque_Nm(model, q[1:-1], dq, ddq, LOADED.mass)
    assert np.abs(torques(q, LOADED.mass, LINKS[model][1:]) - ours).max() < 2e-3 * np.abs(ours).max()


def check(model: str, count: int, seed: int) -> None:
    found = hunt(model, count, seed)
    assert found.wrong == []
    assert found.reached.total() + found.refused.total() == count
    reached, refused = found.reached, found.refused
    assert reached["fair"] > 0.5 * (reached["fair"] + refused["fair"]), "an arm that refuses everything proves nothing"
    for kind in ("near the limit", "spike", "past the rod", "into the table"):
        assert reached[kind] > 0, kind
    for kind in ("near the limit", "all near the limit", "fast", "from elsewhere", "cut short", "begun late"):
        assert refused[kind] > 0, kind
    for kind in ("spike", "step", "shaking", "past the rod", "into the table", "not a number"):
        assert refused[kind] > 0, kind
    assert reached["not a number"] == 0


@pytest.mark.parametrize("model", campaign(["fr3", "panda", "fr3v2"], 3))
def test_none_of_1000_paths_beyond_a_limit_reaches_the_driver(model: str) -> None:
    check(model, 1000, seed=1)
