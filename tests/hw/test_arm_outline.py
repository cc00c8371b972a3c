"""The outline contains the maker's meshes of both arms, hand and fingers; so whatever it calls clear is clear."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from arm_meshes import Body, bodies, placed
from capsule_gaps import outside_m
from cells import cell, move
from own_judge import poses

from hw.capsules import Capsule
from hw.collision import BARE_HAND, KeepOut, Table, box_clearance, persons_side, table_clearance
from hw.errors import MotionRefused
from hw.kinematics import link_poses
from hw.outline import ARM, COARSE_ARM, COARSE_HAND, FINGERS, HAND
from hw.types import Array

MODELS = ("panda", "fr3")
NAMES = tuple(body.name for body in bodies("fr3"))
SMALL_M = np.full(3, 0.004)
LIFTED_RAD = (0.02, 1.578, 0.238, -0.563, -2.16, 1.727, 1.123)
"""The maker's capsules are 5.5 mm over the table, the mesh is 14.1 mm below it."""


def outline_of(body: Body) -> tuple[Capsule, ...]:
    return tuple(c for c in (*ARM, *HAND, *FINGERS) if c.link == body.link)


@cache
def points(model: str, spacing_m: float) -> tuple[tuple[int, Array], ...]:
    """Link and points of everything that moves; the fingers are open."""
    return tuple((b.link, b.points_m(spacing_m)) for b in bodies(model, 0.08) if b.link >= 1)


@pytest.mark.parametrize("opening_m", [0.0, 0.045, 0.08])
@pytest.mark.parametrize("model", MODELS)
def test_no_point_of_any_mesh_lies_outside(model: str, opening_m: float) -> None:
    for body in bodies(model, opening_m)[0 if opening_m == 0.0 else 9 :]:
        assert outside_m(body.points_m(0.015), outline_of(body)).max() < 0.0, body.name


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_no_point_of_any_mesh_lies_outside_however_closely_it_is_sampled(model: str) -> None:
    for opening_m in np.linspace(0.0, 0.08, 9):
        for body in bodies(model, opening_m) if opening_m == 0.0 else bodies(model, opening_m)[9:]:
            assert outside_m(body.points_m(0.0015), outline_of(body)).max() < 0.0, body.name


def test_the_makers_own_capsules_are_thinner_than_the_arm() -> None:
    """Why they judge nothing but the arm against itself."""
    worst_m = {}
    for model in MODELS:
        for body in bodies(model)[1:9]:
            coarse = tuple(c for c in (*COARSE_ARM, *COARSE_HAND) if c.link == body.link)
            worst_m[model, body.name] = outside_m(body.triangles_m.reshape(-1, 3), coarse).max()
    assert max(worst_m.values()) > 0.03
    assert min(worst_m.values()) > 0.005


def test_the_button_of_link_7_lies_where_the_meshes_have_it() -> None:
    (button,) = (c for c in COARSE_ARM if c.name == "guide button")
    for model in MODELS:
        mesh = bodies(model)[7].points_m(0.004)
        far = mesh[np.hypot(mesh[:, 0], mesh[:, 1]) > 0.075]
        assert outside_m(far, (button,)).max() < 0.0165, "nearer than with the button on the X axis"
    off = Capsule("on the X axis", 7, np.array([0.055, 0.0, 0.082]), np.array([0.065, 0.0, 0.082]), 0.03)
    assert outside_m(far, (off,)).max() > 0.03


def clearances_hold(model: str, count: int, seed: int, spacing_m: float) -> None:
    """Random postures, boxes, person's sides and tables: the meshes are as clear as the outline says."""
    rng = np.random.default_rng(seed)
    low, high = cell(model).arm.limits.q_min_rad, cell(model).arm.limits.q_max_rad
    counted = 0
    for q_rad in rng.uniform(low, high, (count, 7)):
        X = poses(q_rad[None])[0]  # a kinematics of its own
        program = link_poses(q_rad)
        surface = [(link, placed(at_m, X[link])) for link, at_m in points(model, spacing_m)]
        everything = np.concatenate([at_m for _, at_m in surface])
        centre = everything[rng.integers(len(everything))] + rng.normal(0.0, 0.1, 3)
        half = rng.uniform(0.002, 0.15, 3)
        side = persons_side(("left", "right", "front", "back")[rng.integers(4)], float(rng.uniform(0.25, 0.8)))
        for box in (KeepOut("box", centre - half, centre + half), side):
            clear_m = box_clearance(program, BARE_HAND, box)[0].min()
            gap_m = np.linalg.norm(everything - np.clip(everything, box.low_m, box.high_m), axis=1).min()
            assert gap_m >= clear_m, (q_rad, box)
            counted += clear_m > 0.0
        table = Table(float(rng.uniform(-0.3, 0.3)), *rng.uniform(-0.1, 0.1, 2))
        high_m = table_clearance(program, BARE_HAND, table)[0].min()
        over = np.concatenate([at_m for link, at_m in surface if link >= 2])
        assert (over[:, 2] - table.height_at(over)).min() >= high_m, (q_rad, table)
    assert counted > count / 2


@pytest.mark.parametrize("model", MODELS)
def test_what_the_outline_calls_clear_the_meshes_are(model: str) -> None:
    clearances_hold(model, 80, 0, 0.02)


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_ten_thousand_postures_are_as_clear_as_the_outline_says(model: str) -> None:
    clearances_hold(model, 10_000, 1, 0.01)


@pytest.mark.parametrize("name", NAMES[1:])
@pytest.mark.parametrize("model", MODELS)
def test_a_small_box_on_the_surface_is_refused(model: str, name: str) -> None:
    path = move(np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02]), 0.6)
    body = next(b for b in bodies(model, 0.04) if b.name == name)
    coarse = tuple(c for c in (*COARSE_ARM, *COARSE_HAND) if c.link == body.link)
    corners = body.triangles_m.reshape(-1, 3)
    corner = placed(corners[[outside_m(corners, coarse).argmax()]], link_poses(path.q_rad[0])[body.link])[0]
    with pytest.raises(MotionRefused, match="keep-out"):
        cell(model, keep_out=(KeepOut("glass", corner - SMALL_M, corner + SMALL_M),)).require(path, path.q_rad[0])


def test_a_hand_below_the_table_is_refused() -> None:
    q_rad = np.array(LIFTED_RAD)
    X = poses(q_rad[None])[0]
    over = np.concatenate([placed(at_m, X[link]) for link, at_m in points("fr3", 0.02) if link >= 7])
    assert over[:, 2].min() < -0.005
    path = move(np.array([0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 1.0, start_rad=q_rad)
    with pytest.raises(MotionRefused, match=r"table of (hand|link 7|fingers) and table"):
        cell("fr3").require(path, q_rad)
