"""The scene's frictions, masses and springs, each measured by what it does to the bottle."""

from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from hw.dynamics import GRAVITY_M_S2
from sim.errors import OutOfRange
from sim.tasks.pushing.bottle import sink_m
from sim.tasks.pushing.params import BOTTLE_MASS_KG, PATCH_X_M, STEP_S, PushingUnmodelled
from sim.tasks.pushing.scene import SLOSH_RAD_S, build_scene

MU, E_PA, MU_P, Y_P_M = 0.10, 3e5, 0.50, 0.20
NOTHING_PLACED = np.zeros(2)
ASIDE = RigidTransform([0.4, -0.4, 0.3])
LARGE_PATCH = PushingUnmodelled(patch_size_scale=3.0)
SPEED_M_S, DURATION_S = 0.5, 0.15


class Bench:
    """The scene with the pusher standing still."""

    def __init__(self, parameters, effects=None, X_WT=ASIDE):
        builder = DiagramBuilder()
        self.plant, _ = AddMultibodyPlantSceneGraph(builder, STEP_S)
        build_scene(self.plant, self.plant.world_frame(), X_WT.GetAsMatrix4(), parameters, NOTHING_PLACED, effects)
        self.plant.Finalize()
        self.bottle = self.plant.GetBodyByName("bottle")
        self.simulator = Simulator(builder.Build())
        self.state = self.plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())

    def slide(self, xy_m, velocity_m_s, duration_s):
        """Start upright at `xy_m`; afterwards the pose and the spatial velocity."""
        z_m = 0.05 - sink_m(BOTTLE_MASS_KG)
        self.plant.SetFreeBodyPose(self.state, self.bottle, RigidTransform([*xy_m, z_m]))
        velocity: Any = np.array([*velocity_m_s, 0.0])
        start = SpatialVelocity(w=np.zeros_like(velocity), v=velocity)
        self.plant.SetFreeBodySpatialVelocity(context=self.state, body=self.bottle, V_JpJc=start)
        self.simulator.AdvanceTo(duration_s)
        return self.bottle.EvalPoseInWorld(self.state), self.bottle.EvalSpatialVelocityInWorld(self.state)


def friction_felt(parameters, xy_m, effects=None):
    _, V = Bench(np.array(parameters), effects).slide(xy_m, (SPEED_M_S, 0.0), DURATION_S)
    return (SPEED_M_S - V.translational()[0]) / (GRAVITY_M_S2 * DURATION_S)


@pytest.mark.parametrize("mu", [0.05, 0.10, 0.30])
def test_off_the_patch_the_bottle_feels_the_table(mu):
    assert friction_felt((mu, E_PA, MU_P, Y_P_M), (0.6, -0.1)) == pytest.approx(mu, rel=0.02)


@pytest.mark.parametrize("mu", [0.05, 0.20])
@pytest.mark.parametrize("mu_p", [0.10, 0.25])
def test_on_the_patch_it_feels_the_patch_alone(mu, mu_p):
    felt = friction_felt((mu, E_PA, mu_p, 0.0), (PATCH_X_M - 0.05, 0.0), LARGE_PATCH)
    assert felt == pytest.approx(mu_p, rel=0.02)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_half_on_the_patch_it_is_braked_by_both_and_turned_towards_the_patch(side):
    """Its centre slides along the rim of the patch, which lies on its right or on its left."""
    parameters = np.array([0.05, E_PA, 0.25, side * 0.15])
    _, V = Bench(parameters, LARGE_PATCH).slide((0.68, 0.0), (SPEED_M_S, 0.0), 0.1)
    felt = (SPEED_M_S - V.translational()[0]) / (GRAVITY_M_S2 * 0.1)
    assert felt == pytest.approx(0.15, rel=0.05)
    assert side * V.rotational()[2] > 1.0


def test_nothing_trips_a_bottle_at_the_seam():
    """Over a patch of the table's own friction it slides as if there were none."""
    X, V = Bench(np.array([MU, E_PA, MU, 0.0])).slide((0.62, 0.0), (0.8, 0.0), 0.4)
    assert V.translational()[0] == pytest.approx(0.8 - MU * GRAVITY_M_S2 * 0.4, rel=0.02)
    assert abs(X.translation()[1]) < 1e-3
    assert X.rotation().matrix()[2, 2] > 0.999


def test_the_plate_rubs_with_its_own_friction():
    """On a slope with hardly any friction a bottle slides down along a plate 60° off the fall line.

    It would roll if the plate were rough (2/3 of the pull); at 0.3 it slips: pull sin 60° less 0.3 cos 60°.
    """
    turned_rad, tilt_rad, duration_s = np.deg2rad(60.0), 0.2, 0.15
    out = RollPitchYaw(0.0, 0.0, turned_rad).ToRotationMatrix()  # X out of the plate
    corner_m: Any = np.array([0.5, -0.3, 0.005])
    X_WT = RigidTransform(out, corner_m)
    bench = Bench(np.array([1e-4, 1e6, 0.3, 0.2]), PushingUnmodelled(table_tilt_rad=(0.0, -tilt_rad)), X_WT)
    start = X_WT @ np.array([0.03, 0.02, 0.0])
    _, V = bench.slide(start[:2], (0.0, 0.0), duration_s)
    along = out.matrix()[:, 1]
    expected = GRAVITY_M_S2 * np.sin(tilt_rad) * (np.sin(turned_rad) - 0.3 * np.cos(turned_rad))
    assert abs(V.translational() @ along) / duration_s == pytest.approx(expected, rel=0.05)


def test_a_tilted_table_lets_the_bottle_slide_downhill():
    tilted = PushingUnmodelled(table_tilt_rad=(0.0, 0.2))
    _, V = Bench(np.array([0.05, E_PA, MU_P, Y_P_M]), tilted).slide((0.6, -0.1), (0.0, 0.0), DURATION_S)
    expected = GRAVITY_M_S2 * (np.sin(0.2) - 0.05 * np.cos(0.2)) * DURATION_S
    assert V.translational()[0] == pytest.approx(expected, rel=0.03)


def test_the_bottle_has_the_inertia_of_a_cylinder_about_its_centre_of_mass():
    heavy = PushingUnmodelled(bottle_mass_scale=2.0, com_height_m=0.03)
    bench = Bench(np.array([MU, E_PA, MU_P, Y_P_M]), heavy)
    M = bench.bottle.CalcSpatialInertiaInBodyFrame(bench.state)
    about_com = M.Shift(M.get_com()).CalcRotationalInertia().get_moments()
    assert M.get_mass() == pytest.approx(0.6)
    np.testing.assert_allclose(M.get_com(), [0.0, 0.0, -0.02])
    np.testing.assert_allclose(about_com, [0.6 * (3 * 0.03**2 + 0.1**2) / 12] * 2 + [0.6 * 0.03**2 / 2], rtol=1e-9)


def test_liquid_swings_at_the_first_mode_of_a_cylinder():
    """Half of the mass sloshes; the bottle stands on a rough patch and does not move."""
    half_full = PushingUnmodelled(slosh_share=0.5, patch_size_scale=3.0)
    bench = Bench(np.array([0.2, 1e6, 0.9, 0.0]), half_full)
    joint = bench.plant.GetJointByName("slosh_x")
    joint.set_translation(bench.state, 0.005)
    bench.slide((PATCH_X_M, 0.0), (0.0, 0.0), np.pi / SLOSH_RAD_S)
    assert joint.get_translation(bench.state) == pytest.approx(-0.005 * np.exp(-0.05 * np.pi), rel=0.15)


def test_the_hard_base_sinks_in_as_far_as_its_weight_asks():
    depth_m = sink_m(0.3)
    assert np.pi * 0.028**2 * 1e7 * depth_m / 0.01 == pytest.approx(0.3 * 9.81)  # pressure e depth / (h / 2)
    assert depth_m < 1e-5


def test_a_patch_that_leaves_the_table_is_refused():
    with pytest.raises(OutOfRange, match="leaves the table"):
        Bench(np.array([MU, E_PA, MU_P, 0.58]))
