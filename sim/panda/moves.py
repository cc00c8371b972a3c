"""Joint paths from one posture to another: smooth in time, at rest at both ends."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from hw.joint_limits import JointLimits, derivatives
from hw.types import PATH_RATE_HZ, Array, JointPath, frozen_array
from sim.errors import NotExecutable

PEAK_SPEED, PEAK_ACCELERATION, PEAK_JERK = 2.1875, 7.5132, 52.5
"""Largest derivatives of `smooth_step` over unit time."""

MOVE_RATIO = 0.95
"""Largest share of a joint's limits that a move uses."""

Along = Callable[[Array], Array]

_STRETCH = 1.25
_TRIES = 16


def smooth_step(u: Array) -> Array:
    """0 to 1 while u goes from 0 to 1, with velocity, acceleration and jerk zero at both ends (seventh order)."""
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3))


def move_path(q_from_rad: ArrayLike, q_to_rad: ArrayLike, limits: JointLimits, speed: float = 0.3) -> JointPath:
    """Move all joints together from one posture (7,) to another (7,), at `speed` times the fastest possible.

    Raises NotExecutable if an end lies outside the position limits.
    """
    q_from, q_to = frozen_array(q_from_rad, (7,), "q_from_rad"), frozen_array(q_to_rad, (7,), "q_to_rad")
    distance = np.abs(q_to - q_from)
    fastest_s = max(
        PEAK_SPEED * (distance / limits.dq_max_rad_s).max(),
        np.sqrt(PEAK_ACCELERATION * (distance / limits.ddq_max_rad_s2).max()),
        np.cbrt(PEAK_JERK * (distance / limits.dddq_max_rad_s3).max()),
    )

    def along(share: Array) -> Array:
        return np.asarray(q_from + share[:, None] * (q_to - q_from))

    return time_curve(along, max(fastest_s / speed, 0.05), limits)


def time_curve(along: Along, duration_s: float, limits: JointLimits) -> JointPath:
    """The joint curve `along` (share (N,) of the way -> (N, 7)) in `duration_s`, or slower if limits require it.

    Raises NotExecutable near a position limit or a singularity, where a slower motion does not help either.
    """
    held = along(np.linspace(0.0, 1.0, 101))
    still = np.zeros_like(held)
    place = float(limits.ratios(held, still, still)[0].max())
    for _ in range(_TRIES if place <= MOVE_RATIO else 0):
        t_s = np.arange(round(duration_s * PATH_RATE_HZ) + 1) / PATH_RATE_HZ
        q_rad = along(smooth_step(t_s / t_s[-1]))
        if _ratio(q_rad, limits) <= MOVE_RATIO:
            return JointPath(t_s, q_rad)
        duration_s *= _STRETCH
    raise NotExecutable(
        f"{limits.model}: a move comes to {place:.2f} of a joint's position limits (largest allowed {MOVE_RATIO:g}), "
        "or is too fast even when slow; choose other end postures"
    )


def join_paths(*paths: JointPath) -> JointPath:
    """Paths in sequence; each starts where the previous one rests. They must have no contact windows."""
    for before, after in pairwise(paths):
        if np.abs(after.q_rad[0] - before.q_rad[-1]).max() > 1e-9 or before.contact or after.contact:
            raise ValueError("paths can be joined only at rest, in the same posture and away from contact")
    q_rad = np.concatenate([paths[0].q_rad, *(p.q_rad[1:] for p in paths[1:])])
    return JointPath(np.arange(len(q_rad)) / PATH_RATE_HZ, q_rad)


def _ratio(q_rad: Array, limits: JointLimits) -> float:
    dq, ddq, dddq = derivatives(q_rad)
    q = np.concatenate([q_rad, np.repeat(q_rad[-1:], len(dq) - len(q_rad), axis=0)])
    return float(max(limits.ratios(q, dq, ddq).max(), (np.abs(dddq) / limits.dddq_max_rad_s3).max()))
