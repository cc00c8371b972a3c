"""Pushing in MuJoCo.

The bottle's base is a bed of points on a plane, and its band a stack of discs against the plate; each has its share of
the stiffness by its modulus. The two rings of points have the load, tilting stiffness and spinning resistance of a
full disc under even pressure. Each point has the friction of the surface under it.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import mujoco
import numpy as np
from scipy.optimize import brentq

from hw.dynamics import GRAVITY_M_S2
from hw.types import Array
from perception.types import ObjectTrack
from sim.research.mujoco.contact import add_pair, set_softness
from sim.research.mujoco.stepping import OBJECT, TOOL, add_carriage, new_scene, run, set_inertia, written
from sim.tasks.pushing.bottle import rest_pose, sink_m
from sim.tasks.pushing.mount import PLATE_HEIGHT_M, PLATE_MASS_KG, PLATE_THICKNESS_M, PLATE_WIDTH_M
from sim.tasks.pushing.params import (
    ACTION,
    BASE_HEIGHT_M,
    BASE_RADIUS_M,
    BOTTLE_HEIGHT_M,
    BOTTLE_MASS_KG,
    BOTTLE_RADIUS_M,
    PARAMETERS,
    PATCH_SIZE_M,
    PATCH_X_M,
    PLATE_FRICTION,
    PushingUnmodelled,
)
from sim.tasks.pushing.plan import plan
from sim.tasks.pushing.rollout import course_of, track_of
from sim.tasks.pushing.scene import DISSIPATION_S_M, SLOSH_DAMPING_RATIO, SLOSH_LIMIT_M, SLOSH_RAD_S
from sim.tasks.shared.carriage import Drive
from sim.tasks.shared.gravity import gravity_m_s2
from sim.tasks.shared.readings import Course, Readings
from sim.types import ToolMotion

STEP_S = 0.0005

_RINGS = ((1.0, 16, 1.0 / 3.0), (0.5, 8, 2.0 / 3.0))
"""Radius as a share of the base's, number of points, and share of the load (Radau's quadrature of a disc)."""

_POINT_M = 0.0005
"""Radius of a point."""

STEP_UP_M = 1e-5
"""Height of the patch in a file: more than the bottle sinks in, so that points on it do not touch the table."""

_DISCS = 8
BAND_M = BOTTLE_HEIGHT_M - BASE_HEIGHT_M
"""Height of the band, which starts above the base."""

SPEED_M_S = float(ACTION.low[1] + ACTION.high[1]) / 2.0
"""The impact, in the middle of the range, for which wall and plate match the stiffness and bounce of hydroelastic
contact."""


def simulate(
    parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: PushingUnmodelled | None = None
) -> ObjectTrack:
    """Push once (see `sim.tasks.task.Simulate`)."""
    X_BO = rest_pose(context, parameters, nuisance, unmodelled)
    return track_of(readings(plan(context, action), X_BO, parameters, nuisance, unmodelled))


def readings(
    motion: ToolMotion, X_BO: Array, parameters: Array, nuisance: Array, unmodelled: PushingUnmodelled | None
) -> Readings:
    """The readings of the motion against a bottle at X_BO (4, 4)."""
    effects = unmodelled or PushingUnmodelled()
    course = course_of(motion, X_BO, nuisance, unmodelled)
    model = scene(course.drive, parameters, effects)
    under = partial(_feel_what_is_under, *_friction_map(model, parameters, effects))
    return run(course, model, effects.dt_s or STEP_S, under)


def scene(drive: Drive, parameters: Array, effects: PushingUnmodelled) -> Any:
    """The compiled model: table, bottle, and pusher on its carriage. At first the whole table has the friction mu."""
    spec = _described(drive, parameters, effects)
    model = spec.compile()
    _soften(model, PARAMETERS.named(parameters).e, effects, _shares())
    return model


def mjcf(course: Course, parameters: Array, nuisance: Array) -> str:
    """The scene at the start of a trial as a file that no program changes while it runs: the patch is a low step.

    (4, 4) pose and nuisance are in the course.
    """
    spec = _described(course.drive, parameters, PushingUnmodelled())
    half_m, top_m = PATCH_SIZE_M / 2, STEP_UP_M / 2
    p = PARAMETERS.named(parameters)
    at, size = (PATCH_X_M, p.y_p, top_m), (half_m, half_m, top_m)
    spec.worldbody.add_geom(name="patch", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=at, **_UNTOUCHED)
    on_patch = {f"patch_{name}": share for name, share in _shares().items()}
    for name in _shares():
        add_pair(spec, f"patch_{name}", name, "patch", p.mu_p)
    spec.option.timestep = STEP_S
    model = spec.compile()
    _soften(model, p.e, PushingUnmodelled(), _shares() | on_patch)
    return written(spec, model, course)


def _described(drive: Drive, parameters: Array, effects: PushingUnmodelled) -> Any:
    spec = new_scene(gravity_m_s2(*effects.table_tilt_rad))
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(2.0, 2.0, 0.1), **_UNTOUCHED)
    _add_pusher(add_carriage(spec, drive))
    _add_bottle(spec, effects)
    _add_contacts(spec, PARAMETERS.named(parameters).mu)
    return spec


_UNTOUCHED = {"contype": 0, "conaffinity": 0}
"""Contact flags of every geom: only named pairs touch."""


def _add_pusher(parent: Any) -> None:
    size_m = np.array([PLATE_THICKNESS_M, PLATE_WIDTH_M, PLATE_HEIGHT_M])
    centre_m = (-PLATE_THICKNESS_M / 2, 0.0, PLATE_HEIGHT_M / 2)
    pusher = parent.add_body(name=TOOL)
    pusher.gravcomp = 1.0
    set_inertia(pusher, PLATE_MASS_KG, centre_m, PLATE_MASS_KG / 12.0 * np.diag((size_m**2).sum() - size_m**2))
    pusher.add_geom(name="plate", type=mujoco.mjtGeom.mjGEOM_BOX, size=size_m / 2, pos=centre_m, **_UNTOUCHED)


def _add_bottle(spec: Any, effects: PushingUnmodelled) -> None:
    mass_kg = BOTTLE_MASS_KG * effects.bottle_mass_scale
    solid_kg = mass_kg * (1.0 - effects.slosh_share)
    across = (3.0 * BOTTLE_RADIUS_M**2 + BOTTLE_HEIGHT_M**2) / 12.0
    bottle = spec.worldbody.add_body(name=OBJECT)
    bottle.add_freejoint(name=OBJECT)
    central = solid_kg * np.diag([across, across, BOTTLE_RADIUS_M**2 / 2.0])
    set_inertia(bottle, solid_kg, (0.0, 0.0, effects.com_height_m - BOTTLE_HEIGHT_M / 2), central)
    for name, p_m, _ in _points():
        bottle.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(_POINT_M, 0, 0), pos=p_m, **_UNTOUCHED)
    half_m = BAND_M / _DISCS / 2
    for i in range(_DISCS):
        at = (0.0, 0.0, (2 * i + 1) * half_m + BASE_HEIGHT_M - BOTTLE_HEIGHT_M / 2)
        size = (BOTTLE_RADIUS_M, half_m, 0)
        bottle.add_geom(name=f"disc_{i}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=size, pos=at, **_UNTOUCHED)
    if effects.slosh_share > 0.0:
        _add_slosh(bottle, mass_kg * effects.slosh_share, effects.slosh_height_m)


def _points() -> list[tuple[str, tuple[float, float, float], float]]:
    """Name, place on the bottle's bottom and share of the load."""
    height_m = _POINT_M - BOTTLE_HEIGHT_M / 2
    points = []
    for ring, (radius, n, share) in enumerate(_RINGS):
        for i in range(n):
            angle = 2.0 * math.pi * (i + 0.5) / n
            r = radius * BASE_RADIUS_M
            points.append((f"point_{ring}_{i}", (r * math.cos(angle), r * math.sin(angle), height_m), share / n))
    return points


def _add_slosh(bottle: Any, mass_kg: float, height_m: float) -> None:
    """Add a mass that slides across the bottle on two damped springs, like the liquid's first mode."""
    slosh = bottle.add_body(name="slosh", pos=(0.0, 0.0, height_m - BOTTLE_HEIGHT_M / 2))
    set_inertia(slosh, mass_kg, (0.0, 0.0, 0.0), 0.4 * mass_kg * (BOTTLE_RADIUS_M / 2) ** 2 * np.eye(3))
    for name, axis in (("slosh_x", (1.0, 0.0, 0.0)), ("slosh_y", (0.0, 1.0, 0.0))):
        joint = slosh.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        joint.range, joint.limited = (-SLOSH_LIMIT_M, SLOSH_LIMIT_M), True
        joint.stiffness = (mass_kg * SLOSH_RAD_S**2, 0.0, 0.0)
        joint.damping = (2.0 * SLOSH_DAMPING_RATIO * SLOSH_RAD_S * mass_kg, 0.0, 0.0)


def _add_contacts(spec: Any, mu: float) -> None:
    """Add pairs of points and table, and of discs and plate."""
    for name, _, _ in _points():
        add_pair(spec, name, name, "table", mu)
    for i in range(_DISCS):
        add_pair(spec, f"disc_{i}", f"disc_{i}", "plate", PLATE_FRICTION)


def _shares() -> dict[str, float]:
    """The share of the load of each point."""
    return {name: share for name, _, share in _points()}


def _soften(model: Any, e_Pa: float, effects: PushingUnmodelled, shares: dict[str, float]) -> None:
    """Set the softness.

    At the bottom, the weight sinks in as in hydroelastic contact, with Hunt and Crossley's dissipation at that load.
    For the front see `wall`.
    """
    mass_kg = BOTTLE_MASS_KG * effects.bottle_mass_scale
    dissipation_s_m = DISSIPATION_S_M / effects.plate_restitution_scale
    weight_N = mass_kg * GRAVITY_M_S2
    for name, share in shares.items():
        set_softness(model, name, share * weight_N / sink_m(mass_kg), share * weight_N * dissipation_s_m)
    stiffness, damping = wall(mass_kg, e_Pa, dissipation_s_m)
    for i in range(_DISCS):
        set_softness(model, f"disc_{i}", stiffness / _DISCS, damping / _DISCS)


def wall(mass_kg: float, e_Pa: float, dissipation_s_m: float) -> tuple[float, float]:
    """Spring (N/m) and damper (Ns/m) of a bottle's band when the plate hits it at `SPEED_M_S`.

    A plane pressed by delta into a band of radius R and length L meets the force 4/3 e L sqrt(2 / R) delta^1.5
    (the pressure is e depth / R). The spring absorbs the energy of the impact over the same depth; the damper gives the
    same bounce.
    """
    energy_J = mass_kg * SPEED_M_S**2 / 2.0
    rise = 4.0 / 3.0 * e_Pa * BAND_M * math.sqrt(2.0 / BOTTLE_RADIUS_M)
    depth_m = (2.5 * energy_J / rise) ** 0.4
    stiffness = 2.0 * energy_J / depth_m**2
    ratio = damping_ratio(bounce(dissipation_s_m * SPEED_M_S))
    return stiffness, 2.0 * ratio * math.sqrt(stiffness * mass_kg)


def bounce(dissipation: float) -> float:
    """Speed after over speed before the impact by Hunt and Crossley's law, `dissipation` = d times the speed before.

    The exponent of the elastic force does not matter: d v = u, (1 + e) u = ln((1 + u) / (1 - e u)).
    """
    u = dissipation
    most = min(1.0, 1.0 / u) * (1.0 - 1e-12)
    return float(brentq(lambda e: (1.0 + e) * u - math.log((1.0 + u) / (1.0 - e * u)), 0.0, most))


def damping_ratio(bounced: float) -> float:
    """Damping ratio of a spring and damper that cannot pull and have this bounce (from nearly 0 to nearly 1)."""

    def excess(ratio: float) -> float:
        root = math.sqrt(abs(1.0 - ratio**2))
        if ratio < 1.0:
            exponent = 2.0 * ratio / root * math.atan2(root, ratio)
        else:
            exponent = ratio / root * math.log((ratio + root) / (ratio - root))
        return exponent + math.log(bounced)

    return float(brentq(excess, 1e-9, 1e6))


def _friction_map(model: Any, parameters: Array, effects: PushingUnmodelled) -> tuple[Any, Any, Array, Array]:
    """Pairs and geoms of the points, friction of table and patch (2,), and the patch's (2, 2) corners."""
    p = PARAMETERS.named(parameters)
    names = [name for name, _, _ in _points()]
    pairs = np.array([model.pair(name).id for name in names])
    geoms = np.array([model.geom(name).id for name in names])
    half_m = PATCH_SIZE_M * effects.patch_size_scale / 2
    centre_m = np.array([PATCH_X_M, p.y_p])
    return pairs, geoms, np.array([p.mu, p.mu_p]), np.stack([centre_m - half_m, centre_m + half_m])


def _feel_what_is_under(pairs: Any, geoms: Any, friction: Array, corners_m: Array, model: Any, data: Any) -> None:
    xy_m = data.geom_xpos[geoms, :2]
    on_patch = ((xy_m >= corners_m[0]) & (xy_m <= corners_m[1])).all(axis=1)
    model.pair_friction[pairs, :2] = np.where(on_patch, friction[1], friction[0])[:, None]
