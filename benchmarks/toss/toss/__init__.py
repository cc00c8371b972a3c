"""Toss: a cube is thrown onto a table and should come to rest at a goal, with a wanted face on top.

A task package as another lab would write it (docs/guide/add-a-task.md). Its real trials are recorded tosses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hw.types import Array, frozen_array
from perception.types import ObjectTrack, Outcome
from sim.solvers.grid import grid_solver
from sim.tasks.task import AdaptationSettings, LabReport, Observation, Task
from sim.types import Dimension, Space
from toss.physics import Table

NEAR_M = 0.1
"""A cube that rests this far from its goal earns nothing."""

ANY = -1.0
"""Instead of a wanted face: any. Only the reference context has it, so that it favours no face."""

PARAMETERS = Space(
    (
        Dimension("mu", "", 0.05, 0.40, plain="friction", meaning="coefficient between cube and table"),
        Dimension("modulus", "Pa", 2e4, 5e6, "log", plain="modulus", meaning="hydroelastic; how hard the cube is"),
        Dimension("dissipation", "s/m", 0.2, 20.0, "log", plain="dissipation", meaning="how little the cube bounces"),
    )
)
CONTEXT = Space(
    (
        Dimension("goal_x", "m", -0.12, 0.12, plain="goal x", meaning="where the cube should rest"),
        Dimension("goal_y", "m", -0.12, 0.12, plain="goal y", meaning="where the cube should rest"),
        Dimension("face", "", 0, 5, "integer", plain="face", meaning="which should be on top: +x, -x, +y, -y, +z, -z"),
    )
)
ACTION = Space(
    tuple(
        Dimension(name, unit, low, high, plain=plain, meaning="of the cube when it is released")
        for name, unit, low, high, plain in (
            ("turn_x", "rad", -math.pi, math.pi, "turn x"),
            ("turn_y", "rad", -math.pi, math.pi, "turn y"),
            ("turn_z", "rad", -math.pi, math.pi, "turn z"),
            ("x", "m", -0.5, 0.5, "place x"),
            ("y", "m", -0.5, 0.5, "place y"),
            ("z", "m", 0.05, 0.25, "height"),
            ("spin_x", "rad/s", -12.0, 12.0, "spin x"),
            ("spin_y", "rad/s", -12.0, 12.0, "spin y"),
            ("spin_z", "rad/s", -12.0, 12.0, "spin z"),
            ("v_x", "m/s", -1.6, 1.6, "speed x"),
            ("v_y", "m/s", -1.6, 1.6, "speed y"),
            ("v_z", "m/s", -0.8, 0.8, "speed z"),
        )
    )
)
STATE = ("x", "y", "z", "up_x", "up_y", "up_z")
"""Columns of a track: the centre in metres, and the table's normal in the frame of the cube."""


@dataclass(frozen=True)
class Unmodelled:
    """The effects that a world may add and that no parameter expresses."""

    slope_rad: float = 0.0  # of the table; positive: towards -x


def simulate(parameters: Array, context: Array, action: Array, nuisance: Array, unmodelled: Any = None) -> ObjectTrack:
    """One toss (see `sim.tasks.task.Simulate`)."""
    effects = unmodelled or Unmodelled()
    try:
        flight = _table(*map(float, parameters), effects.slope_rad).toss(np.array(action, dtype=np.float64))
    except RuntimeError as error:
        return track_of(np.zeros(1), np.zeros((1, 3)), np.array([[0.0, 0.0, 0.0, 1.0]]), str(error).splitlines()[0])
    return track_of(flight.t_s, flight.position_m, flight.rotation)


def track_of(t_s: Array, position_m: Array, rotation: Array, failure: str = "") -> ObjectTrack:
    """The track of a cube at (N, 3) with quaternions x, y, z, w (N, 4)."""
    up = Rotation.from_quat(rotation).inv().apply([0.0, 0.0, 1.0])
    return ObjectTrack(
        t_s,
        np.concatenate([position_m, up], axis=1),
        Outcome.SOLVER_FAILED if failure else Outcome.SETTLED,
        np.full(3, np.nan),
        np.ones(len(t_s)),
        (failure,) if failure else (),
    )


def face_on_top(up: Array) -> Array:
    """(..., 3) the table's normal in the frame of the cube -> (...) the face, 0 to 5."""
    axis = np.abs(up).argmax(axis=-1)
    return np.asarray(2 * axis + (np.take_along_axis(up, axis[..., None], axis=-1)[..., 0] < 0.0))


def reward_of_success(end: Array, context: Array) -> Array:
    """0 unless the wanted face is on top; else 1 at the goal, falling to 0 at `NEAR_M`."""
    off_m, wanted = np.linalg.norm(end[..., :2] - context[..., :2], axis=-1), context[..., 2]
    shows = (face_on_top(end[..., 2:5]) == wanted) | (wanted == ANY)
    return np.where(shows, np.maximum(0.0, 1.0 - off_m / NEAR_M), 0.0)


def end_state(track: ObjectTrack) -> Array:
    """(5,) place x, y, and the table's normal in the frame of the cube."""
    return track.state[-1, [0, 1, 3, 4, 5]]


@lru_cache(maxsize=256)
def _table(mu: float, modulus_Pa: float, dissipation_s_m: float, slope_rad: float) -> Table:
    return Table(mu, modulus_Pa, dissipation_s_m, slope_rad)


TASK = Task(
    name="toss",
    title="toss a cube onto a goal",
    object_name="cube",
    parameters=PARAMETERS,
    margin=PARAMETERS,
    context=CONTEXT,
    action=ACTION,
    nuisance=Space(()),
    action_noise=frozen_array(np.zeros(len(ACTION))),
    observation=Observation(
        times_s=frozen_array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0]),
        columns=(0, 1, 2, 3, 4, 5),
        low=frozen_array([-0.5, -0.5, 0.0, -1.0, -1.0, -1.0]),
        high=frozen_array([0.5, 0.5, 0.3, 1.0, 1.0, 1.0]),
        noise_mean=frozen_array(np.zeros(6)),
        noise_std=frozen_array([0.001, 0.001, 0.001, 0.01, 0.01, 0.01]),
        curves=("x [m]", "y [m]", "z [m]", "up x", "up y", "up z"),
    ),
    adaptation=AdaptationSettings(
        horizon=5, delta=0.15, discount=0.9, threshold=0.5, trials_per_iteration=2, learning_rate=1e-3
    ),
    unmodelled=Unmodelled,
    simulate=simulate,
    reference_context=frozen_array([0.0, 0.0, ANY]),
    relocate=lambda observation, context: observation,
    succeeded=lambda track: track.outcome is Outcome.SETTLED,
    end_state=end_state,
    reward_of_success=reward_of_success,
    goal_m=lambda context: context[:2],
    exact=grid_solver,
    report=LabReport(
        columns=("x [m]", "y [m]", "z [m]", "up_x [1]", "up_y [1]", "up_z [1]"),
        outcomes=(Outcome.SETTLED,),
        successes=(Outcome.SETTLED,),
    ),
)
