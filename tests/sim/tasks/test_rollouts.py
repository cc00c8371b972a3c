"""Rollouts in Drake: they end as they should, feel every effect of a world, and never raise.

That they repeat exactly is in the contract of tasks.
"""

import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant

from perception.types import REST_M_S, REST_S, Outcome
from sim.tasks import get_task
from sim.tasks.pushing import params as pushing
from sim.tasks.pushing.plan import plan as push_plan
from sim.tasks.scooping import params as scooping
from sim.tasks.scooping import scene
from sim.tasks.shared import direct

PUSHING, SCOOPING = get_task("pushing"), get_task("scooping")
NOMINAL = np.array([0.12, 2e5, 0.4, 0.05])  # mu, e, mu_p, y_p
STRAIGHT, GOAL = np.array([0.0, 0.6]), np.array([0.85, 0.0])
CYLINDER, LATE_AND_FLAT = np.array([0.30, 1e5, 1, 2.0]), np.array([0.10, 0.05, 0.018])
OLIVE, OLIVE_RADIUS, ROLLED_ON = np.array([0.326, 2.2e5, 0, 2.08]), np.array([0.011]), [-0.0043, 0.0508, 0.0055]
HERE = scooping.REFERENCE_CONTEXT


def push(parameters=NOMINAL, action=STRAIGHT, placed=(0.0, 0.0), effects=None, goal=GOAL):
    return PUSHING.simulate(np.array(parameters), goal, np.array(action), np.array(placed), effects)


def scoop(parameters=CYLINDER, action=LATE_AND_FLAT, radius=(0.0125,), effects=None, context=HERE):
    return SCOOPING.simulate(np.array(parameters), context, np.array(action), np.array(radius), effects)


@pytest.fixture(scope="module")
def pushed():
    return push()


@pytest.fixture(scope="module")
def scooped():
    return scoop()


def test_a_push_moves_the_bottle_ahead_and_it_stays_upright(pushed):
    assert pushed.outcome is Outcome.UPRIGHT
    assert pushed.t_s[0] == 0.0
    np.testing.assert_allclose(pushed.state[0, :2], pushing.START_M)
    assert 0.70 < pushed.state[-1, 0] < 1.0
    assert abs(pushed.state[-1, 1]) < 0.03
    assert 0.0 < PUSHING.score(pushed, GOAL) < 1.0
    np.testing.assert_allclose(pushed.state[1], pushed.state[0], atol=2e-4)  # nothing happens before it is touched
    assert pushed.t_s[1] > 0.1


def test_it_is_recorded_until_the_bottle_rests(pushed):
    speed_m_s = np.linalg.norm(pushed.state[-1] - pushed.state[-2]) / (pushed.t_s[-1] - pushed.t_s[-2])
    assert speed_m_s < 20 * REST_M_S
    slippery = push([0.05, 2e5, 0.2, 0.3], [0.0, 0.65])
    assert slippery.t_s[-1] > 1.3
    assert np.hypot(*(slippery.state[-1] - slippery.at(np.array([1.3]))[0])[:2]) > 0.005


def test_the_goal_moves_nothing_but_the_reward(pushed):
    elsewhere = np.array([0.95, 0.1])
    np.testing.assert_array_equal(push(goal=elsewhere).state, pushed.state)
    assert PUSHING.score(pushed, elsewhere) != PUSHING.score(pushed, GOAL)


def test_yaw_turns_the_push_about_the_start():
    moved_m = push([0.12, 2e5, 0.4, 0.4], [0.2, 0.5]).state[-1, :2] - pushing.START_M
    assert np.arctan2(moved_m[1], moved_m[0]) == pytest.approx(0.2, abs=0.03)


def test_a_rough_patch_in_the_way_throws_a_top_heavy_bottle_over():
    rough = [0.06, 1e5, 0.9, 0.0]
    assert push(rough, effects=pushing.PushingUnmodelled(com_height_m=0.08)).outcome is Outcome.TIPPED
    assert push(rough).outcome is Outcome.UPRIGHT


def test_a_bottle_that_nothing_brakes_leaves_the_table():
    away = push([0.005, 1e6, 0.005, 0.0], [0.0, 0.8])
    assert away.outcome is Outcome.LOST
    assert PUSHING.score(away, GOAL) == 0.0


def test_a_misplaced_bottle_starts_where_it_was_placed():
    placed = np.array([0.003, -0.002])
    np.testing.assert_allclose(push(placed=placed).state[0, :2], pushing.START_M + placed)


def test_the_tool_follows_the_plan(pushed):
    """Where the bottle ends in the tool frame tells where the carriage is: the end of the planned motion, or on its way
    there when the bottle rested earlier."""
    X_BT = push_plan(GOAL, STRAIGHT).X_BT
    p_BT_m = pushed.state[-1] - X_BT[-1, :3, :3] @ pushed.end_in_tool_m
    assert np.abs(p_BT_m - X_BT[:, :3, 3]).sum(axis=1).min() < 0.02


def test_a_gentle_late_scoop_lifts_a_cylinder(scooped):
    assert scooped.outcome is Outcome.ON_BLADE
    assert 0.8 <= SCOOPING.score(scooped, HERE) <= 1.0
    assert scooped.t_s[0] == 0.0
    assert 1.0 <= scooped.t_s[-1] < 1.2
    assert scooped.state[-1, 2] > 0.03
    assert scooped.state[-1, 0] > scooped.state[0, 0] + 0.1


def test_an_olive_rolls_down_the_blade_to_the_neck_and_rests_there():
    """At 1.0 s, when the paper looks for the last time, it is still rolling."""
    track = scoop(OLIVE, ROLLED_ON, OLIVE_RADIUS)
    assert track.outcome is Outcome.ON_BLADE
    assert track.flags == ()
    assert -0.10 < track.end_in_tool_m[0] < -0.085


def test_without_the_neck_it_rolls_off(monkeypatch):
    monkeypatch.setattr(scene, "NECK_SIZE_M", (0.001, 0.001, 0.001))
    track = scoop(OLIVE, ROLLED_ON, OLIVE_RADIUS)
    assert track.outcome is not Outcome.ON_BLADE
    assert track.t_s[-1] > 1.0


def test_a_piece_that_stands_still_for_a_moment_is_not_at_rest():
    """What rolls to and fro is slow where it turns: a rollout ends only after it has been slow for a while."""
    track = scoop([0.335, 4.73e5, 0, 2.343], [0.1804, 0.038, 0.0144], [0.013])
    last = track.t_s > track.t_s[-1] - REST_S - 0.001
    assert np.linalg.norm(np.ptp(track.state[last], axis=0)) < 2 * REST_M_S * REST_S


def test_elsewhere_on_the_table_the_same_happens_there(scooped):
    context = np.array([0.70, -0.02])
    there = SCOOPING.observation(scoop(context=context))
    np.testing.assert_allclose(SCOOPING.relocate(SCOOPING.observation(scooped), context), there, atol=0.01)


def test_a_blade_held_like_a_wall_lifts_nothing():
    assert scoop(effects=scooping.ScoopingUnmodelled(pitch_bias_rad=0.5)).outcome is not Outcome.ON_BLADE


@pytest.mark.parametrize("parameters", [[0.30, 5e4, 0, 2.0], [0.2, 1e6, 0, 2.8], [0.4, 1e4, 2, 1.9]])
def test_the_piece_lies_still_until_it_is_touched(parameters):
    far = scoop(parameters, [0.0, 0.1, 0.020])
    before = far.state[far.t_s < 0.15]
    assert np.abs(before - before[0]).max() < 5e-4


@pytest.mark.parametrize(
    ("run", "effects"),
    [
        (push, pushing.PushingUnmodelled(bottle_mass_scale=1.5)),
        (push, pushing.PushingUnmodelled(com_height_m=0.03)),
        (push, pushing.PushingUnmodelled(slosh_share=0.4)),
        (push, pushing.PushingUnmodelled(patch_size_scale=2.0)),
        (push, pushing.PushingUnmodelled(table_tilt_rad=(0.02, 0.0))),
        (push, pushing.PushingUnmodelled(plate_restitution_scale=10.0)),
        (push, pushing.PushingUnmodelled(contact="sap")),
        (push, pushing.PushingUnmodelled(dt_s=0.00125)),
        (scoop, scooping.ScoopingUnmodelled(semi_axis_scale=(1.2, 0.9))),
        (scoop, scooping.ScoopingUnmodelled(density_scale=0.8, com_offset_m=(0.002, 0.0, 0.0))),
        (scoop, scooping.ScoopingUnmodelled(second_friction_scale=0.5)),
        (scoop, scooping.ScoopingUnmodelled(blade_flex_rad=0.05)),
        (scoop, scooping.ScoopingUnmodelled(distance_bias_m=0.005)),
        (scoop, scooping.ScoopingUnmodelled(contact="lagged")),
    ],
)
def test_every_effect_of_a_world_changes_what_happens(run, effects, pushed, scooped):
    changed, usual = run(effects=effects), {push: pushed, scoop: scooped}[run]
    assert changed.outcome is not Outcome.SOLVER_FAILED
    moments_s = np.array([1.0, changed.t_s[-1]])
    assert np.abs(changed.at(moments_s) - usual.at(moments_s)).max() > 1e-5


@pytest.mark.parametrize(("run", "task", "until_s"), [(push, PUSHING, 0.4), (scoop, SCOOPING, 0.3)])
def test_a_solver_that_gives_up_is_an_outcome_with_a_reason(monkeypatch, run, task, until_s):
    class Stuck(direct.Simulator):  # type: ignore[misc, name-defined]
        def AdvanceTo(self, boundary_time):
            if boundary_time > until_s:
                raise RuntimeError("did not converge")
            return super().AdvanceTo(boundary_time)

    monkeypatch.setattr(direct, "Simulator", Stuck)
    failed = run()
    assert failed.outcome is Outcome.SOLVER_FAILED
    assert "did not converge" in failed.flags[0]
    assert task.score(failed, task.reference_context) == 0.0


def test_scene_has_tool_piece_and_pictures_of_both():
    hardware = SCOOPING.require_hardware()
    plant, graph = MultibodyPlant(time_step=hardware.time_step_s(None)), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(graph)
    bodies = hardware.build_scene(plant, plant.world_frame(), np.eye(4), CYLINDER, OLIVE_RADIUS, None)
    plant.Finalize()
    assert {bodies.object, bodies.tool, "world"} <= {visual.body for visual in bodies.visuals}
    for visual in bodies.visuals:
        assert visual.triangles.max() < len(visual.vertices_m)
        assert visual.body == "world" or plant.HasBodyNamed(visual.body)
    assert plant.num_positions() == 7
    assert hardware.time_step_s(scooping.ScoopingUnmodelled(dt_s=0.001)) == 0.001
