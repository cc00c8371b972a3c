"""A contact in MuJoCo is the spring and damper that were asked for, whatever it carries."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sim.research.mujoco.contact import add_pair, set_softness
from sim.research.mujoco.pushing import bounce, damping_ratio
from sim.research.mujoco.stepping import new_scene, set_inertia

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


def run(model, data, seconds: float) -> None:
    for _ in range(round(seconds / STEP_S)):
        mujoco.mj_step(model, data)


@pytest.mark.parametrize(("stiffness", "damping"), [(500.0, 15.0), (5_000.0, 40.0), (500.0, 60.0)])
def test_a_weight_sinks_in_by_weight_over_stiffness(stiffness: float, damping: float) -> None:
    model, data = ball(stiffness, damping)
    run(model, data, 3.0)
    assert RADIUS_M - data.qpos[2] == pytest.approx(MASS_KG * 9.81 / stiffness, rel=1e-3)


def test_a_ball_that_lies_too_deep_comes_up_over_the_relaxation_time() -> None:
    """Damped far over the critical, what lies deeper than its weight asks creeps out as exp(-t K / B)."""
    stiffness, relaxation_s = 1_000.0, 0.12
    model, data = ball(stiffness, stiffness * relaxation_s)
    rest_m = RADIUS_M - MASS_KG * 9.81 / stiffness
    data.qpos[2] = rest_m - 0.0005
    run(model, data, relaxation_s)
    assert rest_m - data.qpos[2] == pytest.approx(0.0005 / np.e, rel=0.05)


@pytest.mark.parametrize("wanted", [0.8, 0.4, 0.15])
def test_a_ball_bounces_as_its_damper_was_chosen_for(wanted: float) -> None:
    stiffness, speed_m_s = 2_000.0, 0.3
    damping = 2.0 * damping_ratio(wanted) * np.sqrt(stiffness * MASS_KG)
    model, data = ball(stiffness, damping, gravity_m_s2=0.0)
    data.qvel[2] = -speed_m_s
    run(model, data, 0.5)
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
