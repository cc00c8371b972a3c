"""Sealed worlds: a fresh seed, kept, and opened by one version of the code."""

import pytest

from adaptsim_cli.config import load
from adaptsim_cli.errors import UsageError
from adaptsim_cli.research import sealed
from adaptsim_cli.research.sealed import seal_of
from sim.storage.files import read_toml
from sim.tasks import get_task


def seal(targets, task="pendulum"):
    return seal_of(load({"task": task}), targets)


def test_the_seed_is_drawn_once_and_a_smaller_set_is_the_beginning_of_a_larger_one(place):
    assert seal("wd,ood-1") is None
    whole, part = seal("sealed"), seal("sealed-3")
    assert whole.seed == part.seed == read_toml(whole.path)["seed"]
    names = [world.name for world in whole.worlds(get_task("pendulum"))]
    assert len(names) == 40
    assert [world.name for world in part.worlds(get_task("pendulum"))] == names[:3]
    assert {world.set for world in part.worlds(get_task("pendulum"))} == {"sealed"}
    foods = seal("sealed-foods-2", "scooping")
    assert foods.worlds(get_task("scooping"))[1].name == f"foods-{foods.seed}-1"


def test_another_version_may_not_run_sessions_in_opened_worlds(place, monkeypatch):
    monkeypatch.setattr(sealed, "code_version", lambda: "first")
    opened = seal("sealed")
    opened.open()
    opened.open()
    assert read_toml(opened.path)["commit"] == "first"
    monkeypatch.setattr(sealed, "code_version", lambda: "second")
    with pytest.raises(
        UsageError, match=r"were opened by version first, but this is second: remove .* to draw fresh ones"
    ):
        opened.open()
    opened.path.unlink()
    seal("sealed").open()
    assert read_toml(opened.path)["commit"] == "second"


@pytest.mark.parametrize("targets", ["sealed,wd", "sealed-1", "sealed-41", "sealed-drawn"])
def test_sealed_worlds_stand_alone(place, targets):
    with pytest.raises(UsageError, match="sealed worlds stand alone"):
        seal(targets)
