"""Spaces, rewards and effects: what is the paper's, what it is worth, what is refused, and the words for it."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import replace

import numpy as np
import pytest

from hw.dynamics import GRAVITY_M_S2
from perception.types import ObjectTrack, Outcome
from sim.errors import OutOfRange, UnknownName
from sim.lab.world import load_world
from sim.tasks import TASKS, get_task
from sim.tasks.fingerprint import fingerprint
from sim.tasks.pushing import params as pushing
from sim.tasks.scooping import params as scooping
from sim.tasks.shared.gravity import gravity_m_s2
from sim.types import Dimension, Space

PUSHING, SCOOPING = get_task("pushing"), get_task("scooping")


@pytest.mark.parametrize(
    ("dimension", "title"),
    [
        (Dimension("h", "cm", 1.0, 2.0, plain="piece height"), "piece height h [cm]"),
        (Dimension("k11", "N m/rad", 0.0, 1.0, plain="gain k11"), "gain k11 [N m/rad]"),
        (Dimension("mu", "", 0.0, 1.0, plain="friction"), "friction mu"),
        (Dimension("speed", "m/s", 0.0, 1.0, plain="speed"), "speed [m/s]"),
        (Dimension("mu", "", 0.0, 1.0), "mu"),
    ],
)
def test_a_title_has_plain_name_name_and_unit(dimension: Dimension, title: str) -> None:
    assert dimension.title == title


@pytest.mark.parametrize("name", TASKS)
def test_every_number_has_words_which_change_no_fingerprint_and_no_equality(name: str) -> None:
    task = get_task(name)
    for space in (task.parameters, task.context, task.action, task.nuisance):
        assert all(d.plain and 0 < len(d.meaning) <= 100 for d in space.dimensions)
        assert len({d.plain for d in space.dimensions}) == len(space)
    bare = Space(tuple(dataclasses.replace(d, plain="", meaning="") for d in task.parameters.dimensions))
    assert bare == task.parameters
    assert fingerprint(dataclasses.replace(task, parameters=bare)) == fingerprint(task)


@pytest.mark.parametrize("name", TASKS)
def test_a_margin_holds_the_range_and_has_the_same_names_units_and_scales(name: str) -> None:
    task = get_task(name)
    for usual, wide in zip(task.parameters.dimensions, task.margin.dimensions, strict=True):
        assert wide.low <= usual.low < usual.high <= wide.high
        assert replace(wide, low=usual.low, high=usual.high) == usual


def test_values_have_their_names_and_another_number_of_them_is_refused() -> None:
    space = get_task("scooping").parameters
    p = space.named(np.array([0.3, 2e5, 1.0, 2.0]))
    assert (p.mu, p.e, p.g, p.h) == (0.3, 2e5, 1.0, 2.0)
    with pytest.raises(AttributeError, match="no quantity 'nu': there are mu, e, g, h"):
        _ = p.nu
    with pytest.raises(ValueError, match="zip"):
        space.named(np.zeros(3))
    assert space.columns(np.arange(8.0).reshape(2, 4))["e"].tolist() == [1.0, 5.0]


def test_a_mirrored_push_turns_what_its_dimensions_say() -> None:
    mirror = get_task("pushing").mirror
    assert mirror is not None
    signs = [part.tolist() for part in (mirror.parameters, mirror.action, mirror.nuisance)]
    assert signs == [[1.0, 1.0, 1.0, -1.0], [-1.0, 1.0], [1.0, -1.0]]


def test_gravity_pulls_to_the_side_that_is_down() -> None:
    x, y, z = gravity_m_s2(left_up_rad=0.02, far_down_rad=0.03)
    assert x > 0.0 > y and z < 0.0  # ahead, and to the right
    assert np.hypot(np.hypot(x, y), z) == pytest.approx(GRAVITY_M_S2)


def test_an_unknown_task_lists_what_there_is() -> None:
    with pytest.raises(UnknownName, match=r"juggling.*scooping"):
        get_task("juggling")


def test_ranges_of_pushing_are_those_of_the_paper() -> None:
    """Table A2 and A4.1."""
    np.testing.assert_allclose(pushing.PARAMETERS.low, [0.05, 1e4, 0.2, -0.1])
    np.testing.assert_allclose(pushing.PARAMETERS.high, [0.20, 1e6, 0.8, 0.1])
    np.testing.assert_allclose([*pushing.ACTION.low, *pushing.ACTION.high], [-0.3, 0.4, 0.3, 0.8])
    targets = [(0.1, 1e5, 0.6, 0.05), (0.25, 5e4, 0.1, -0.1), (0.05, 1e5, 0.9, 0.05), (0.15, 5e6, 0.1, -0.15)]
    assert all(pushing.MARGIN.contains(np.array(target)) for target in [*targets, (0.30, 1e5, 0.15, 0.1)])
    for name in ("wd", "ood-1", "ood-2", "ood-3", "ood-4"):
        pushing.MARGIN.check(load_world(name, PUSHING).parameters, name)
    assert (pushing.ACTION_NOISE / (pushing.ACTION.high - pushing.ACTION.low)).max() < 0.05


def test_goals_fill_the_wedge_in_front_of_the_bottle_and_earn_1_and_20_cm_from_them_nothing() -> None:
    contexts = pushing.CONTEXT.denormalise(np.array(list(itertools.product((0.0, 0.5, 1.0), repeat=2))))
    goals_m = pushing.goal_m(contexts)
    assert goals_m[:, 0].min() == pytest.approx(0.7)
    assert goals_m[:, 0].max() == pytest.approx(1.0)
    seen = np.arctan2(goals_m[:, 1] - pushing.START_M[1], goals_m[:, 0] - pushing.START_M[0])
    assert np.abs(np.rad2deg(seen)).max() == pytest.approx(10.0)
    assert np.abs(goals_m[:, 1]).max() == pytest.approx(0.0776, abs=1e-4)
    for away_m, reward in (([0.0, 0.0], 1.0), ([0.0, 0.1], 0.5), ([0.2, 0.01], 0.0)):
        np.testing.assert_allclose(PUSHING.reward_of_success(goals_m + away_m, contexts), reward)


def test_wherever_the_bottle_may_be_placed_it_passes_the_check_of_5_mm() -> None:
    assert np.hypot(*pushing.NUISANCE.high) < 0.005
    assert np.hypot(*pushing.NUISANCE.low) < 0.005


@pytest.mark.parametrize(
    ("outcome", "end_m", "reward"),
    [
        (Outcome.ON_BLADE, (-0.05, 0.0, 0.01), 1.0),
        (Outcome.ON_BLADE, (-0.05, 0.025, 0.01), 0.9),
        (Outcome.ON_BLADE, (0.0, 0.04, 0.01), 0.8),
        (Outcome.ON_TABLE, (-0.05, 0.0, 0.01), 0.0),
        (Outcome.LOST, (-0.05, 0.0, 0.01), 0.0),
        (Outcome.SOLVER_FAILED, (-0.05, 0.0, 0.01), 0.0),
    ],
)
def test_the_reward_of_a_scoop_is_that_of_the_public_code(
    outcome: Outcome, end_m: tuple[float, ...], reward: float
) -> None:
    track = ObjectTrack(np.array([0.0, 1.0]), np.zeros((2, 3)), outcome, np.array(end_m), np.ones(2))
    assert SCOOPING.score(track, scooping.REFERENCE_CONTEXT) == pytest.approx(reward)


def test_an_observation_of_scooping_moves_with_the_piece_and_one_of_pushing_stays() -> None:
    here = SCOOPING.observation.normalise(np.tile([0.7, 0.01], (8, 1)))
    assert here.shape == (16,)
    moved = SCOOPING.relocate(here, scooping.REFERENCE_CONTEXT + np.array([0.01, -0.02]))
    np.testing.assert_allclose(SCOOPING.observation.denormalise(moved), np.tile([0.71, -0.01], (8, 1)))
    pushes = np.random.default_rng(0).random((7, 12))
    np.testing.assert_array_equal(PUSHING.relocate(pushes, np.ones((7, 2))), pushes)
    assert PUSHING.relocate(pushes[0], np.zeros((7, 2))).shape == (7, 12)


def test_friction_of_the_blade_gives_the_pair_its_share() -> None:
    mu, effects = 0.3, scooping.ScoopingUnmodelled(second_friction_scale=0.7)
    blade = effects.friction_of_blade(mu)
    assert 2 * mu * blade / (mu + blade) == pytest.approx(0.7 * mu)
    assert scooping.ScoopingUnmodelled().friction_of_blade(mu) == pytest.approx(mu)


@pytest.mark.parametrize(
    ("task", "effects"),
    [
        (SCOOPING, {"semi_axis_scale": (1.0, 0.0)}),
        (SCOOPING, {"density_scale": -1.0}),
        (SCOOPING, {"second_friction_scale": 2.0}),
        (SCOOPING, {"blade_flex_rad": -0.01}),
        (SCOOPING, {"contact": "sticky"}),
        (SCOOPING, {"dt_s": 0.0}),
        (PUSHING, {"bottle_mass_scale": 0.0}),
        (PUSHING, {"dt_s": -0.001}),
        (PUSHING, {"com_height_m": 0.11}),
        (PUSHING, {"slosh_share": 1.0}),
        (PUSHING, {"table_tilt_rad": (0.0, 0.5)}),
        (PUSHING, {"contact": "penalty"}),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_impossible_effects_are_refused_by_name(task, effects) -> None:
    with pytest.raises(OutOfRange, match=next(iter(effects))):
        task.unmodelled(**effects)
