from dataclasses import replace

import numpy as np
import pytest
from toy_task import TOY

from sim.errors import UnknownName
from sim.lab.drawn import effects_of
from sim.lab.foods import step_s, volume_m3
from sim.lab.world import list_worlds, load_world
from sim.research.benchmark.worlds import DRAWN, TABLE_A2, targets_of, usual_targets
from sim.tasks import get_task
from sim.tasks.scooping.params import BLUNT_STEP_S

PUSHING, SCOOPING = get_task("pushing"), get_task("scooping")


def test_drawn_worlds_are_always_the_same_forty_and_none_is_of_both_sets():
    develop, drawn = (targets_of(PUSHING, [name]) for name in ("develop", "drawn"))
    assert len(develop) == len(drawn) == DRAWN
    assert [t.name for t in drawn[:2]] == ["drawn-2-0", "drawn-2-1"]
    again = targets_of(PUSHING, ["drawn"])
    assert all(np.array_equal(a.world.parameters, b.world.parameters) for a, b in zip(drawn, again, strict=True))
    values = {t.world.parameters.tobytes() for t in (*develop, *drawn)}
    assert len(values) == 2 * DRAWN


def test_one_drawn_world_is_asked_for_by_its_name_and_keeps_its_set():
    (alone,) = targets_of(PUSHING, ["drawn-2-3"])
    assert alone.set == "drawn"
    assert alone.world.parameters.tolist() == targets_of(PUSHING, ["drawn"])[3].world.parameters.tolist()
    assert targets_of(PUSHING, ["drawn-0-3"])[0].set == "develop"
    assert [t.name for t in targets_of(PUSHING, ["drawn-3"])][::39] == ["drawn-3-0", "drawn-3-39"]
    with pytest.raises(UnknownName, match="drawn-2-40"):
        targets_of(PUSHING, ["drawn-2-40"])


def test_worlds_of_the_pendulum_are_drawn_too_and_have_no_unmodelled_effects():
    drawn = targets_of(get_task("pendulum"), ["drawn"])
    assert len(drawn) == DRAWN
    assert not any(effects_of(get_task("pendulum"), target.world) for target in drawn)


def test_forty_foods_are_always_the_same_and_as_the_rule_says():
    foods = targets_of(SCOOPING, ["foods"])
    assert [t.name for t in foods[::39]] == ["foods-5-0", "foods-5-39"]
    assert {t.set for t in (*foods, *targets_of(SCOOPING, ["foods-5-3"]))} == {"foods"}
    assert {t.set for t in targets_of(SCOOPING, ["foods-4-3"])} == {"foods-4"}
    for target in foods:
        friction, modulus_Pa, shape, height_cm = target.world.parameters
        effects = target.world.unmodelled
        assert 0.20 <= friction <= 0.45
        assert 1e4 <= modulus_Pa <= 1e6
        assert shape in (0, 1, 2)
        assert 0.4 <= height_cm <= 2.5
        assert 0.005 <= target.world.nuisance[0] <= 0.023
        assert 0.3 <= effects.density_scale <= 1.2
        assert 0.0007 <= effects.lip_m <= 0.0011
        assert 1.5e3 <= effects.edge_stiffness_N_m <= 5e3
    with pytest.raises(UnknownName, match="not of pushing"):
        targets_of(PUSHING, ["foods"])


@pytest.mark.parametrize("name", ["raisin", "carrot", "cucumber", "sprout", "mushroom-slice", "oreo"])
def test_the_rule_of_the_step_gives_the_steps_that_were_measured_for_the_papers_foods(name: str):
    world = load_world(name, SCOOPING)
    shape, height_m = int(world.parameters[2]), world.parameters[3] / 100.0
    mass_kg = 1000.0 * world.unmodelled.density_scale * volume_m3(shape, world.nuisance[0], height_m)
    assert step_s(mass_kg, world.unmodelled.edge_stiffness_N_m) == (world.unmodelled.dt_s or BLUNT_STEP_S)


def test_a_world_that_is_named_twice_is_one_target_of_the_set_that_named_it_first():
    found = targets_of(PUSHING, ["wd", "named", "wd", "mujoco"])
    assert [t.name for t in found[:1]] == ["wd"]
    assert sorted(t.name for t in found) == list(list_worlds(PUSHING))
    assert {t.set for t in found if t.world.physics == "drake"} == {"named"}


@pytest.mark.parametrize("asked", ["mujoco", "mujoco-wd"])
def test_worlds_of_a_foreign_physics_are_a_set_of_their_own(asked: str):
    found = targets_of(PUSHING, [asked])
    assert "mujoco-wd" in {t.name for t in found}
    assert {(t.set, t.world.physics) for t in found} == {("mujoco", "mujoco")}
    assert not {t.name for t in found} & {t.name for t in targets_of(PUSHING, ["named"])}


def test_the_usual_targets_are_the_papers_and_all_worlds_of_another_task():
    assert usual_targets(PUSHING) == usual_targets(SCOOPING) == TABLE_A2
    assert usual_targets(replace(TOY, name="own", worlds={"slick": {}, "dry": {}})) == ("dry", "slick")


def test_an_unknown_target_names_the_worlds_and_the_sets():
    with pytest.raises(UnknownName, match=r"no world 'marsh' for pushing; there are .*wd.*sets of worlds are develop"):
        targets_of(PUSHING, ["marsh"])
    with pytest.raises(UnknownName, match="no target was given"):
        targets_of(PUSHING, [])
