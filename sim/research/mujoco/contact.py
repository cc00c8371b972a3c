"""Sets spring and damper of MuJoCo's contacts in N/m and Ns/m, which MuJoCo has no parameters for.

MuJoCo makes each contact a constraint with a reference acceleration -b v - k r and a regulariser R = (1 - d) A / d, A
the inverse of the mass that the contact moves. Its force is -(k/R) r - (b/R) v - a/R: a spring k/R, a damper b/R and an
inertia 1/R. Given as "-stiffness, -damping" (solref), k and b are these numbers over d, so that a spring K and a damper
B are solref = (-K, -B) (1 - d) A. The impedance d remains free. It is chosen so that the damper outweighs the inertia,
which no material has, after `INERTIA_S`: 1/R = B times that.
"""

from __future__ import annotations

from typing import Any

import mujoco

INERTIA_S = 0.001
"""Longer than two steps, so that no damper overshoots."""

FRICTION_IN_PLANE, FRICTIONLESS = 3, 1


def add_pair(spec: Any, name: str, one: str, other: str, friction: float) -> None:
    """Let two geoms touch: frictionless if `friction` is 0, else with sliding friction only."""
    pair = spec.add_pair(name=name, geomname1=one, geomname2=other)
    pair.condim = FRICTION_IN_PLANE if friction > 0.0 else FRICTIONLESS
    pair.friction = (friction, friction, 0.0, 0.0, 0.0)


def set_softness(model: Any, name: str, stiffness_N_m: float, damping_Ns_m: float) -> None:
    """Spring and damper of every contact of a pair in a compiled model."""
    pair = model.pair(name).id
    bodies = (model.geom_bodyid[geom[pair]] for geom in (model.pair_geom1, model.pair_geom2))
    inverse_mass = float(sum(model.body_invweight0[body, 0] for body in bodies))
    heavier = inverse_mass * damping_Ns_m * INERTIA_S
    d = min(max(heavier / (1.0 + heavier), mujoco.mjMINIMP), mujoco.mjMAXIMP)
    factor = (1.0 - d) * inverse_mass
    model.pair_solref[pair] = (-stiffness_N_m * factor, -damping_Ns_m * factor)
    model.pair_solimp[pair] = (d, d, 0.001, 0.5, 2.0)
