"""Worlds of a foreign physics: what a file may say, and what is said where the physics cannot be had."""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.errors import ExtraMissing, NoHardware, WorldError
from sim.lab.physics import effects_in, in_physics, simulate_of
from sim.lab.rollout import rollout_in, task_in
from sim.lab.simulated import SimulatedLab, truth_of
from sim.lab.touch import TouchLab
from sim.lab.world import list_worlds, load_world
from sim.panda.tool import cell_as_shipped
from sim.research.benchmark.tables import world_digest
from sim.research.mujoco import scooping
from sim.tasks import get_task
from sim.tasks.fingerprint import scene_key

SCOOPING = get_task("scooping")
ACTION = np.array([0.10, 0.05, 0.018])
FILE = 'task = "scooping"\nphysics = "mujoco"\n[params]\nmu = 0.3\ne = 1e5\ng = 1\nh = 2.0\n'


def load(tmp_path: Path, text: str, task=SCOOPING):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return load_world(str(path), task)


@pytest.mark.parametrize("name", ["pushing", "scooping"])
def test_three_worlds_of_each_task_are_mujocos(name: str) -> None:
    task = get_task(name)
    worlds = {world.name: world for world in (load_world(found, task) for found in list_worlds(task))}
    foreign = {world for world in worlds if worlds[world].physics == "mujoco"}
    assert foreign == {"mujoco-wd", "mujoco-ood-1", "mujoco-ood-4"}
    for world in foreign:
        twin = worlds[world.removeprefix("mujoco-")]
        assert np.array_equal(worlds[world].parameters, twin.parameters)
        assert worlds[world].unmodelled == twin.unmodelled


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ('[unmodelled]\ncontact = "lagged"\n', "chooses among Drake's contact laws"),
        ("[sensing]\nframe_drop = 0.1\n", r"\[sensing\] describes arm and camera"),
        ("[mount]\ntable_height_mm = 1.0\n", r"\[mount\] describes arm and camera"),
        ("[faults]\narm_reflex = [1]\n", r"\[faults\] describes arm and camera"),
    ],
)
def test_what_mujoco_does_not_have_is_refused(tmp_path: Path, more: str, why: str) -> None:
    with pytest.raises(WorldError, match=why):
        load(tmp_path, FILE + more)


def test_what_a_file_does_not_say_is_drakes_and_other_physics_and_tasks_are_refused(tmp_path: Path) -> None:
    assert load(tmp_path, FILE).physics == "mujoco"
    assert load(tmp_path, FILE.replace('physics = "mujoco"\n', "")).physics == "drake"
    with pytest.raises(WorldError, match="'physics' in the top level is 'bullet'"):
        load(tmp_path, FILE.replace('"mujoco"', '"bullet"'))
    pendulum = get_task("pendulum")
    wd = load_world("wd", pendulum)
    params = "\n".join(f"{n} = {v}" for n, v in zip(pendulum.parameters.names, wd.parameters, strict=True))
    text = f'task = "pendulum"\nphysics = "mujoco"\n[params]\n{params}\n'
    with pytest.raises(WorldError, match="exists for pushing and scooping, not for pendulum"):
        load(tmp_path, text, pendulum)


def test_a_rollout_in_a_world_takes_all_but_context_and_action_from_it() -> None:
    pendulum = get_task("pendulum")
    world, action, middle = load_world("ood-1", pendulum), pendulum.action.middle, pendulum.parameters.middle
    found = rollout_in(world, pendulum.reference_context, action)
    there = pendulum.simulate(world.parameters, pendulum.reference_context, action, world.nuisance, world.unmodelled)
    elsewhere = pendulum.simulate(middle, pendulum.reference_context, action, world.nuisance)
    assert np.array_equal(found.state, there.state)
    asked = middle, pendulum.reference_context, action, world.nuisance
    assert np.array_equal(task_in(world, pendulum).simulate(*asked).state, there.state)
    assert not np.array_equal(found.state, elsewhere.state)


def test_its_rollouts_are_mujocos_and_travel_to_another_process() -> None:
    world = load_world("mujoco-wd", SCOOPING)
    there = pickle.loads(pickle.dumps(task_in(world, SCOOPING).simulate))  # noqa: S301 - what was pickled here
    found = there(np.zeros(4), SCOOPING.reference_context, ACTION, np.zeros(1))
    asked = world.parameters, SCOOPING.reference_context, ACTION, world.nuisance
    assert np.array_equal(found.state, scooping.simulate(*asked).state)
    assert not np.array_equal(found.state, SCOOPING.simulate(*asked).state)


def test_the_lab_of_arm_and_camera_says_what_is_possible_instead() -> None:
    world, cell = load_world("mujoco-wd", SCOOPING), cell_as_shipped(SCOOPING.require_hardware(), "panda")
    instead = r"trials run without arm and camera.*`adaptsim run-iteration` and `adaptsim rollout` work"
    with pytest.raises(NoHardware, match=instead):
        SimulatedLab(SCOOPING, world, 0, cell)
    with pytest.raises(NoHardware, match="trials run without arm and camera"):
        TouchLab(SCOOPING, world, 0, cell, home_q_rad=np.zeros(7))


def test_its_truth_leaves_out_the_effects_of_drake() -> None:
    truth = truth_of(SCOOPING, load_world("mujoco-wd", SCOOPING))
    assert truth["physics"] == "mujoco"
    assert "contact" not in truth["unmodelled"]
    assert "contact" in effects_in("drake", SCOOPING.unmodelled())


def test_without_mujoco_the_install_line_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [name for name in sys.modules if name.startswith("sim.research.mujoco")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ExtraMissing, match=r"needs the package mujoco.*pip install .*\[mujoco\]'"):
        simulate_of("scooping", "mujoco")


@pytest.mark.long
def test_nobody_imports_mujoco_who_does_not_ask_for_it() -> None:
    code = (
        "import sys; from sim.lab.world import load_world; from sim.lab.rollout import task_in; "
        "from sim.tasks import get_task; import sim.adaptation.checkpoint, sim.research.pretraining.pipeline; "
        "task_in(load_world('mujoco-wd', get_task('pushing')), get_task('pushing')); sys.exit('mujoco' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=120).returncode == 0


@pytest.mark.long
def test_tables_of_a_physics_are_not_mistaken_for_those_of_another() -> None:
    """World tables are kept by the digest of their world and the key of their scene."""
    world = load_world("mujoco-wd", SCOOPING)
    assert world_digest(SCOOPING, world) != world_digest(SCOOPING, replace(world, physics="drake"))
    assert scene_key(in_physics(SCOOPING, "mujoco")) != scene_key(SCOOPING)
    assert in_physics(SCOOPING, "drake") is SCOOPING
