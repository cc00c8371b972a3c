"""Rollouts in Drake: they repeat exactly, do what they look like, and never raise."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from perception.types import REST_M_S, REST_S, Outcome
from sim.tasks.scooping import HARDWARE, TASK, scene
from sim.tasks.scooping.params import REFERENCE_CONTEXT, Unmodelled
from sim.tasks.shared import direct

CYLINDER = np.array([0.30, 1e5, 1, 2.0])
ELLIPSOID = np.array([0.30, 5e4, 0, 2.0])
LATE_AND_FLAT = np.array([0.10, 0.05, 0.018])
RADIUS = np.array([0.0125])


def scoop(parameters=CYLINDER, context=REFERENCE_CONTEXT, action=LATE_AND_FLAT, effects=None):
    return TASK.simulate(parameters, context, action, RADIUS, effects)


@pytest.fixture(scope="module")
def scooped():
    return scoop()


def test_a_gentle_late_scoop_lifts_a_cylinder(scooped):
    assert scooped.outcome is Outcome.ON_BLADE
    assert 0.8 <= TASK.score(scooped, REFERENCE_CONTEXT) <= 1.0
    assert scooped.t_s[0] == 0.0
    assert 1.0 <= scooped.t_s[-1] < 1.2
    assert scooped.state[-1, 2] > 0.03
    assert scooped.state[-1, 0] > scooped.state[0, 0] + 0.1


OLIVE, OLIVE_RADIUS = np.array([0.326, 2.2e5, 0, 2.08]), np.array([0.011])
ROLLED_ON = np.array([-0.0043, 0.0508, 0.0055])


def test_an_olive_rolls_down_the_blade_to_the_neck_and_rests_there():
    """At 1.0 s, when the paper looks for the last time, it is still rolling."""
    track = TASK.simulate(OLIVE, REFERENCE_CONTEXT, ROLLED_ON, OLIVE_RADIUS)
    assert track.outcome is Outcome.ON_BLADE
    assert track.flags == ()
    assert -0.10 < track.end_in_tool_m[0] < -0.085


def test_without_the_neck_it_rolls_off(monkeypatch):
    monkeypatch.setattr(scene, "NECK_SIZE_M", (0.001, 0.001, 0.001))
    track = TASK.simulate(OLIVE, REFERENCE_CONTEXT, ROLLED_ON, OLIVE_RADIUS)
    assert track.outcome is not Outcome.ON_BLADE
    assert track.t_s[-1] > 1.0


def test_a_piece_that_stands_still_for_a_moment_is_not_at_rest():
    """What rolls to and fro is slow where it turns: a rollout ends only after it has been slow for a while."""
    parameters, nuisance = np.array([0.335, 4.73e5, 0, 2.343]), np.array([0.013])
    track = TASK.simulate(parameters, REFERENCE_CONTEXT, np.array([0.1804, 0.038, 0.0144]), nuisance)
    last = track.t_s > track.t_s[-1] - REST_S - 0.001
    assert np.linalg.norm(np.ptp(track.state[last], axis=0)) < 2 * REST_M_S * REST_S


def test_the_same_scoop_repeats_exactly(scooped):
    again = scoop()
    np.testing.assert_array_equal(again.state, scooped.state)
    np.testing.assert_array_equal(again.end_in_tool_m, scooped.end_in_tool_m)


def test_elsewhere_on_the_table_the_same_happens_there(scooped):
    context = np.array([0.70, -0.02])
    there = TASK.observation(scoop(context=context))
    np.testing.assert_allclose(TASK.relocate(TASK.observation(scooped), context), there, atol=0.01)


def test_a_blade_held_like_a_wall_lifts_nothing():
    effects = Unmodelled(pitch_bias_rad=0.5)
    assert scoop(effects=effects).outcome is not Outcome.ON_BLADE


def test_a_solver_that_gives_up_is_an_outcome_with_a_reason(monkeypatch):
    class Stuck(direct.Simulator):  # type: ignore[misc, name-defined]
        def AdvanceTo(self, boundary_time):
            if boundary_time > 0.3:
                raise RuntimeError("did not converge")
            return super().AdvanceTo(boundary_time)

    monkeypatch.setattr(direct, "Simulator", Stuck)
    failed = scoop()
    assert failed.outcome is Outcome.SOLVER_FAILED
    assert "did not converge" in failed.flags[0]
    assert TASK.score(failed, REFERENCE_CONTEXT) == 0.0


@pytest.mark.parametrize(
    "effects",
    [
        Unmodelled(semi_axis_scale=(1.2, 0.9)),
        Unmodelled(density_scale=0.8, com_offset_m=(0.002, 0.0, 0.0)),
        Unmodelled(second_friction_scale=0.5),
        Unmodelled(blade_flex_rad=0.05),
        Unmodelled(distance_bias_m=0.005),
        Unmodelled(contact="lagged"),
    ],
)
def test_every_effect_of_a_world_changes_what_happens(effects, scooped):
    changed = scoop(effects=effects)
    assert changed.outcome is not Outcome.SOLVER_FAILED
    assert np.abs(changed.at(np.array([1.0])) - scooped.at(np.array([1.0]))).max() > 1e-5


@pytest.mark.parametrize("parameters", [ELLIPSOID, np.array([0.2, 1e6, 0, 2.8]), np.array([0.4, 1e4, 2, 1.9])])
def test_the_piece_lies_still_until_it_is_touched(parameters):
    far = scoop(parameters, action=np.array([0.0, 0.1, 0.020]))
    before = far.state[far.t_s < 0.15]
    assert np.abs(before - before[0]).max() < 5e-4


def test_scene_has_tool_piece_and_pictures_of_both():
    plant = MultibodyPlant(time_step=HARDWARE.time_step_s(None))
    from pydrake.geometry import SceneGraph  # noqa: PLC0415 - it must outlive the plant

    scene = SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene)
    bodies = HARDWARE.build_scene(plant, plant.world_frame(), np.eye(4), CYLINDER, RADIUS, None)
    plant.Finalize()
    seen = {visual.body for visual in bodies.visuals}
    assert {bodies.object, bodies.tool, "world"} <= seen
    for visual in bodies.visuals:
        assert visual.triangles.max() < len(visual.vertices_m)
        assert visual.body == "world" or plant.HasBodyNamed(visual.body)
    assert plant.num_positions() == 7
    assert HARDWARE.time_step_s(Unmodelled(dt_s=0.001)) == 0.001
