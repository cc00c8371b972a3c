import numpy as np
import pytest

from sim.errors import UnknownName
from sim.lab.drawn import effects_of
from sim.lab.world import list_worlds
from sim.research.benchmark.worlds import DRAWN, targets_of
from sim.tasks import get_task

PUSHING = get_task("pushing")


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


def test_an_unknown_target_names_the_worlds_and_the_sets():
    with pytest.raises(UnknownName, match=r"no world 'marsh' for pushing; there are .*wd.*sets of worlds are develop"):
        targets_of(PUSHING, ["marsh"])
    with pytest.raises(UnknownName, match="no target was given"):
        targets_of(PUSHING, [])
