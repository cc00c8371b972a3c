"""The judge of the campaigns of faults finds what it is there for, and only that."""

from __future__ import annotations

import numpy as np
import pytest
from arm_meshes import placed
from cells import READY, smooth
from hard_paths import LOADED
from mesh_judge import judged, lowest_m, nearest_m, surfaces, touches_itself
from own_judge import DESCRIPTION, Array, Scene, Touching, poses, published

TIP_F_M = np.array([0.0, 0.0, 0.2])
SHARES = smooth(np.linspace(0.0, 1.0, 900)[:, None])
TURN = READY + SHARES * 0.2 * np.eye(7)[0]


def scene(*boxes: tuple[Array, Array]) -> Scene:
    return Scene(LOADED.mass, TIP_F_M, boxes)


def cube(at_m: Array, half_m: float) -> tuple[Array, Array]:
    return at_m - half_m, at_m + half_m


@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_a_plain_motion_is_right(model: str) -> None:
    assert judged(TURN, TURN[0], model, scene(), None) == ""


@pytest.mark.parametrize("link", [3, 5, 7, 8])
def test_a_box_at_any_vertex_on_the_way_is_found(link: int) -> None:
    part = next(part for part in surfaces("fr3") if part.link == link)
    rng = np.random.default_rng(link)
    for _ in range(3):
        point = part.points_m[rng.integers(len(part.points_m))]
        q = TURN[rng.integers(len(TURN))]
        at_m = placed(point[None], poses(q[None])[:, link])[0, 0]
        assert nearest_m(TURN, "fr3", *cube(at_m, 0.004), TIP_F_M) == 0.0
        assert "of a box" in judged(TURN, TURN[0], "fr3", scene(cube(at_m, 0.004)))


def test_the_distance_is_that_of_every_point_at_every_millisecond() -> None:
    low, high = np.array([0.25, 0.30, 0.55]), np.array([0.30, 0.36, 0.60])
    X, least_m = poses(TURN[::20]), np.inf
    for part in surfaces("panda"):
        at_m = placed(part.points_m, X[:, part.link])
        least_m = min(least_m, float(np.linalg.norm(at_m - np.clip(at_m, low, high), axis=-1).min()))
    assert 0.0 < least_m < 0.3
    assert nearest_m(TURN, "panda", low, high, TIP_F_M) == pytest.approx(least_m, abs=2e-3)


def test_the_table_the_tip_and_the_arm_itself_are_found() -> None:
    down = READY + smooth(np.linspace(0.0, 1.0, 4000)[:, None]) * (1.5 * np.eye(7)[1] - 0.2 * np.eye(7)[3])
    assert lowest_m(down, "panda") < 0.0
    said = judged(down[::-1], down[-1], "panda", scene())
    assert "of the table" in said
    shallow = READY + SHARES * 0.33 * np.eye(7)[1]
    tip = poses(shallow[-1:])[0, 8]
    floor_m = float((tip[:3, :3] @ TIP_F_M + tip[:3, 3])[2]) + 0.0060
    assert "tip 1.50 mm too deep" in judged(
        shallow, shallow[0], "panda", scene(), Touching(0.0, np.inf, 0.004), floor_m=floor_m
    )
    folded = np.array([0.0, -1.0, 0.0, -3.0, 0.0, 0.6, 0.7])
    for model in ("panda", "fr3"):
        assert touches_itself(np.repeat(folded[None], 9, axis=0), model) == "link 1 touches hand"
        assert touches_itself(TURN, model) == ""


def test_inertias_are_the_makers_own_of_each_arm() -> None:
    panda, fr3 = published("panda"), published("fr3")
    assert len(panda) == len(fr3) == 7
    assert panda[0].kg == 2.7907
    assert fr3[0].kg == 2.9274653454
    text = (DESCRIPTION / "fr3" / "inertials.yaml").read_text("utf-8")
    assert all(f"{body.kg:.10g}"[:6] in text for body in fr3)
    for body in (*panda, *fr3):
        np.testing.assert_array_equal(body.inertia_kg_m2, body.inertia_kg_m2.T)
