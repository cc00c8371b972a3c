"""Types of cameras and simulations: the result of tracking, and when a piece lies on the blade of the spatula."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array

REST_M_S, REST_RAD_S = 0.003, 0.1
REST_S = 0.1
SETTLE_S = 2.0
"""In training, in the lab and before a camera, a trial is over once the object has been slower than this (m/s) for
`REST_S`, relative to the table or to the tool that carries it; at the latest `SETTLE_S` after the tool's motion. Then
it is judged, while the tool is where its motion ended (docs/decisions/0003)."""


_SAME_S = 1e-6
"""Times that differ by less are the same."""


class Outcome(StrEnum):
    """How a trial ended."""

    ON_BLADE = "on_blade"
    ON_TABLE = "on_table"
    UPRIGHT = "upright"
    TIPPED = "tipped"
    SETTLED = "settled"
    LOST = "lost"  # out of sight, or off the table
    SOLVER_FAILED = "solver_failed"  # simulation only
    DIVERGED = "diverged"  # the pendulum, under a feedback that does not stabilise it


@dataclass(frozen=True, eq=False)
class ObjectTrack:
    """The object's state through one trial, in the base frame.

    `t_s` counts from the start of the tool's motion. `state` has one row per time: the object's
    centre (x, y, z) in metres for the contact tasks, joint angles in rad for the pendulum.
    """

    t_s: Array  # (N,)
    state: Array  # (N, d)
    outcome: Outcome
    end_in_tool_m: Array  # (3,) object centre in the tool frame at the end; NaN without a tool
    confidence: Array  # (N,) 0 lost ... 1 fully visible and well fitted; simulation: 1
    flags: tuple[str, ...] = ()  # warnings for the operator, in words
    watched_s: tuple[float, float] = (-math.inf, math.inf)
    """First and last time at which the state is known; before and after it is missing, not held."""

    def __post_init__(self) -> None:
        t_s = frozen_array(self.t_s, (None,), "t_s")
        object.__setattr__(self, "t_s", t_s)
        object.__setattr__(self, "state", frozen_array(self.state, (len(t_s), None), "state"))
        object.__setattr__(self, "confidence", frozen_array(self.confidence, (len(t_s),), "confidence"))
        end = np.array(self.end_in_tool_m, dtype=np.float64).reshape(3)
        end.flags.writeable = False
        object.__setattr__(self, "end_in_tool_m", end)

    def at(self, times_s: Array) -> Array:
        """State interpolated at `times_s` (M,) -> (M, d); held constant beyond the ends, NaN outside of `watched_s`."""
        states = np.stack([np.interp(times_s, self.t_s, column) for column in self.state.T], axis=-1)
        first_s, last_s = self.watched_s
        states[(times_s < first_s - _SAME_S) | (times_s > last_s + _SAME_S)] = np.nan
        return states


def in_frames(what: str, which: NDArray[np.bool_], t_s: Array) -> tuple[str, ...]:
    """The flag of the frames at `t_s` (N,) for which `which` (N,) is true; none if it is true for no frame."""
    if not which.any():
        return ()
    first, last = t_s[which][0], t_s[which][-1]
    return (f"{what} in {which.sum()} of {len(t_s)} frames ({first:.2f} to {last:.2f} s)",)


BLADE_LENGTH_M, BLADE_WIDTH_M = 0.10, 0.08
"""The blade's face in T: x from -length to 0, |y| up to half the width, at z = 0."""

BEHIND_M = 0.010
"""How far behind the root of the blade a piece may lie (m): the neck of the tool holds it there."""

ABOVE_FACE_M = 0.001
"""The centre of a piece on the blade is higher than this above the blade's face (m)."""


def is_on_blade(p_TO_m: Array) -> bool:
    """Whether a piece with its centre at (3,) in T lies on the face, or is held by the neck behind it."""
    x_m, y_m, z_m = p_TO_m
    return bool(z_m > ABOVE_FACE_M and -BLADE_LENGTH_M - BEHIND_M <= x_m <= 0.0 and abs(y_m) <= BLADE_WIDTH_M / 2)
