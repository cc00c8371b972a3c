"""Pushing and scooping in MuJoCo: the same bodies as in Drake, the contract of a rollout, and contacts as asked for."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import mujoco
import numpy as np
import pytest
from pydrake.planning import RobotDiagramBuilder

from perception.types import Outcome
from sim.lab.drawn import draw_world
from sim.lab.physics import effects_in
from sim.lab.rollout import rollout_in
from sim.lab.world import load_world
from sim.research.mujoco import pushing, scooping, stepping
from sim.research.mujoco.contact import add_pair, set_softness
from sim.research.mujoco.pushing import bounce, damping_ratio
from sim.research.mujoco.stepping import new_scene, set_inertia
from sim.tasks import get_task
from sim.tasks.shared.carriage import drive_of

TASKS = {"pushing": pushing, "scooping": scooping}
ACTIONS = {"pushing": np.array([-0.28, 0.6]), "scooping": np.array([0.10, 0.05, 0.018])}


@pytest.fixture(params=sorted(TASKS))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def bodies(name: str, seed: int):
    """(mass, centre, inertia about it) of the object in Drake and in MuJoCo, with effects drawn."""
    task = get_task(name)
    world = draw_world(task, np.random.default_rng(seed), effects=set(effects_in("mujoco", task.unmodelled())))
    effects = replace(world.unmodelled, **({"slosh_share": 0.0} if name == "pushing" else {}))
    motion = task.require_hardware().plan(task.reference_context, ACTIONS[name])
    drive = drive_of(motion, import_module(f"sim.tasks.{name}.rollout").ARM)
    asked = (world.parameters,) if name == "pushing" else (world.parameters, world.nuisance)
    model = TASKS[name].scene(drive, *asked, effects)
    body = model.body(stepping.OBJECT)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, body.iquat)
    R = turn.reshape(3, 3)
    robot = RobotDiagramBuilder(time_step=0.001)
    plant = robot.plant()
    hardware = task.require_hardware()
    added = hardware.build_scene(plant, plant.world_frame(), np.eye(4), world.parameters, world.nuisance, effects)
    M = plant.GetBodyByName(added.object).default_spatial_inertia()
    central = M.Shift(M.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    return (M.get_mass(), M.get_com(), central), (body.mass[0], body.ipos, R @ np.diag(body.inertia) @ R.T)


@pytest.mark.parametrize("seed", range(3))
def test_the_object_has_the_mass_and_inertia_of_drakes(name: str, seed: int) -> None:
    for drake, mujoco_ in zip(*bodies(name, seed), strict=True):
        np.testing.assert_allclose(mujoco_, drake, rtol=1e-9, atol=1e-12)


def far_away(name: str):
    """Readings of a motion that never reaches the object."""
    task = get_task(name)
    world, hardware = load_world("mujoco-wd", task), task.require_hardware()
    motion = hardware.plan(task.reference_context, ACTIONS[name])
    X_BO = np.array(hardware.rest_pose(task.reference_context, world.parameters, world.nuisance, None))
    X_BO[1, 3] += 0.35
    found = TASKS[name].readings(motion, X_BO, world.parameters, world.nuisance, None)
    return motion, X_BO, found


def test_an_object_that_nothing_touches_stays_as_deep_as_training_lets_it_sink(name: str) -> None:
    _, X_BO, found = far_away(name)
    assert found.is_settled
    assert np.abs(found.p_BO_m - X_BO[:3, 3]).max() < 2e-5


def test_the_tool_goes_where_the_motion_says() -> None:
    motion, _, found = far_away("scooping")
    planned = motion.X_BT[np.searchsorted(motion.t_s, np.minimum(found.t_s, motion.t_s[-1]) - 1e-9)]
    off_m = np.array([X.translation() for X in found.X_BT]) - planned[:, :3, 3]
    assert np.abs(off_m[:, 1]).max() < 1e-9
    assert np.abs(off_m[-1]).max() < 2e-4  # at the end, free of the table
    assert np.abs(off_m).max() < 6e-3  # the table holds the edge up, and the arm's springs turn that into a way forward


@pytest.mark.parametrize("world", ["mujoco-ood-1", "mujoco-ood-4"])
def test_a_rollout_repeats_itself_and_can_be_scored(name: str, world: str) -> None:
    task = get_task(name)
    target = load_world(world, task)
    one, two = (rollout_in(target, task.reference_context, ACTIONS[name]) for _ in range(2))
    assert np.array_equal(one.state, two.state)
    assert one.outcome is two.outcome is not Outcome.SOLVER_FAILED
    assert 0.0 <= task.score(one, task.reference_context) <= 1.0
    assert task.observation(one).shape == (task.observation.size,)


def test_a_plain_push_and_a_plain_scoop_end_near_drakes(name: str) -> None:
    task, world = get_task(name), load_world("mujoco-wd", get_task(name))
    asked = world.parameters, task.reference_context, ACTIONS[name], world.nuisance
    drake, foreign = task.simulate(*asked), rollout_in(world, task.reference_context, ACTIONS[name])
    assert drake.outcome is foreign.outcome
    assert task.succeeded(foreign)
    apart_m = np.linalg.norm(task.end_state(drake) - task.end_state(foreign))
    assert 0.0 < apart_m < 0.03


def test_half_the_step_changes_next_to_nothing(name: str) -> None:
    task, world = get_task(name), load_world("mujoco-wd", get_task(name))
    asked = world.parameters, task.reference_context, ACTIONS[name], world.nuisance
    whole, half = (TASKS[name].simulate(*asked, task.unmodelled(dt_s=dt_s)) for dt_s in (None, TASKS[name].STEP_S / 2))
    assert whole.outcome is half.outcome
    assert np.linalg.norm(task.end_state(whole) - task.end_state(half)) < 0.004


def test_the_patch_brakes_only_where_it_lies() -> None:
    """A bottle that crosses a rough patch ends short of one that passes beside it."""
    task = get_task("pushing")
    on, beside = (
        pushing.simulate(np.array([0.08, 2e5, 0.5, y_p]), task.reference_context, np.array([0.0, 0.6]), np.zeros(2))
        for y_p in (0.0, 0.14)
    )
    assert on.outcome is beside.outcome is Outcome.UPRIGHT
    assert on.state[-1, 0] < beside.state[-1, 0] - 0.02


@pytest.mark.parametrize(
    ("task", "effect"),
    [
        ("pushing", {"bottle_mass_scale": 2.0}),
        ("pushing", {"com_height_m": 0.03}),
        ("pushing", {"slosh_share": 0.4}),
        ("pushing", {"patch_size_scale": 2.0}),
        ("pushing", {"table_tilt_rad": (0.03, 0.0)}),
        ("pushing", {"plate_restitution_scale": 8.0}),
        ("scooping", {"semi_axis_scale": (1.2, 0.9)}),
        ("scooping", {"density_scale": 0.6}),
        ("scooping", {"com_offset_m": (0.002, 0.0, 0.0)}),
        ("scooping", {"second_friction_scale": 0.5}),
        ("scooping", {"pitch_bias_rad": 0.04}),
        ("scooping", {"blade_flex_rad": 0.08}),
        ("scooping", {"distance_bias_m": 0.005}),
    ],
)
def test_every_effect_moves_the_end(task: str, effect: dict[str, object]) -> None:
    the_task, world = get_task(task), load_world("mujoco-wd", get_task(task))
    asked = world.parameters, the_task.reference_context, ACTIONS[task], world.nuisance
    plain, changed = (TASKS[task].simulate(*asked, the_task.unmodelled(**e)) for e in ({}, effect))
    assert np.abs(plain.at(the_task.observation.times_s) - changed.at(the_task.observation.times_s)).max() > 1e-4


def test_a_state_that_explodes_is_an_outcome_with_a_reason(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    step = mujoco.mj_step

    def explode(model, data) -> None:
        data.qvel[0] = 1e12
        step(model, data)

    monkeypatch.setattr(mujoco, "mj_step", explode)
    monkeypatch.chdir(tmp_path)
    task, world = get_task(name), load_world("mujoco-wd", get_task(name))
    failed = TASKS[name].simulate(world.parameters, task.reference_context, ACTIONS[name], world.nuisance)
    assert failed.outcome is Outcome.SOLVER_FAILED
    assert "MuJoCo's state" in failed.flags[0]
    assert not list(tmp_path.iterdir())  # MuJoCo would write its log there
    assert task.score(failed, task.reference_context) == 0.0


MASS_KG, RADIUS_M, STEP_S = 0.2, 0.01, 0.0005


def ball(stiffness_N_m: float, damping_Ns_m: float, gravity_m_s2: float = 9.81):
    """A ball over a table, as (model, data); its contact begins at 10 mm."""
    spec = new_scene(np.array([0.0, 0.0, -gravity_m_s2]))
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(1, 1, 0.1), contype=0, conaffinity=0)
    body = spec.worldbody.add_body(name="ball")
    body.add_freejoint(name="ball")
    set_inertia(body, MASS_KG, (0.0, 0.0, 0.0), 1e-4 * np.eye(3))
    size = (RADIUS_M, 0, 0)
    body.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=size, contype=0, conaffinity=0)
    add_pair(spec, "pair", "ball", "table", 0.0)
    model = spec.compile()
    set_softness(model, "pair", stiffness_N_m, damping_Ns_m)
    model.opt.timestep = STEP_S
    data = mujoco.MjData(model)
    data.qpos[2] = RADIUS_M
    return model, data


def step(model, data, seconds: float) -> None:
    for _ in range(round(seconds / STEP_S)):
        mujoco.mj_step(model, data)


@pytest.mark.parametrize(("stiffness", "damping"), [(500.0, 15.0), (5_000.0, 40.0), (500.0, 60.0)])
def test_a_weight_sinks_in_by_weight_over_stiffness(stiffness: float, damping: float) -> None:
    model, data = ball(stiffness, damping)
    step(model, data, 3.0)
    assert RADIUS_M - data.qpos[2] == pytest.approx(MASS_KG * 9.81 / stiffness, rel=1e-3)


def test_a_ball_that_lies_too_deep_comes_up_over_the_relaxation_time() -> None:
    """Damped far over the critical, what lies deeper than its weight asks creeps out as exp(-t K / B)."""
    stiffness, relaxation_s = 1_000.0, 0.12
    model, data = ball(stiffness, stiffness * relaxation_s)
    rest_m = RADIUS_M - MASS_KG * 9.81 / stiffness
    data.qpos[2] = rest_m - 0.0005
    step(model, data, relaxation_s)
    assert rest_m - data.qpos[2] == pytest.approx(0.0005 / np.e, rel=0.05)


@pytest.mark.parametrize("wanted", [0.8, 0.4, 0.15])
def test_a_ball_bounces_as_its_damper_was_chosen_for(wanted: float) -> None:
    stiffness, speed_m_s = 2_000.0, 0.3
    damping = 2.0 * damping_ratio(wanted) * np.sqrt(stiffness * MASS_KG)
    model, data = ball(stiffness, damping, gravity_m_s2=0.0)
    data.qvel[2] = -speed_m_s
    step(model, data, 0.5)
    assert data.qvel[2] / speed_m_s == pytest.approx(wanted, abs=0.03)


def test_hunt_and_crossley_lose_what_their_equation_of_motion_loses() -> None:
    """Against an integration of m x'' = -k x^1.5 (1 + d x')."""
    dissipation_s_m, speed_m_s, dt_s = 3.0, 0.6, 1e-6
    x, v = 0.0, speed_m_s
    while True:
        v -= dt_s * 1e6 * max(x, 0.0) ** 1.5 * (1.0 + dissipation_s_m * v)
        x += dt_s * v
        if x <= 0.0:
            break
    assert bounce(dissipation_s_m * speed_m_s) == pytest.approx(-v / speed_m_s, abs=2e-3)
    assert bounce(1e-6) == pytest.approx(1.0, abs=1e-5)
