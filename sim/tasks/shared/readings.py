"""A rollout without its physics: its start, its poses every 20 ms, and its end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from hw.types import Array
from perception.types import REST_M_S, REST_RAD_S, REST_S
from sim.tasks.shared.carriage import Drive

if TYPE_CHECKING:
    from pydrake.math import RigidTransform

READ_EVERY_S = 0.020
_STILL_READINGS = round(REST_S / READ_EVERY_S) + 1
"""This many readings in a row span `REST_S`.

A single reading is not enough, because an object that rolls to and fro is still at each turning point."""


Velocity = tuple[Array, Array]
"""(3,) m/s of a body's origin, and (3,) rad/s."""


@dataclass(frozen=True, eq=False)
class Moment:
    """Tool and object at a reading, in the base."""

    t_s: float  # since the start of the motion
    X_BO: RigidTransform
    X_BT: RigidTransform
    V_BO: Velocity
    V_BT: Velocity

    @property
    def is_still_on_table(self) -> bool:
        """Whether the object is slow enough for rest on the table."""
        return _is_slow(*self.V_BO)

    @property
    def is_still_on_tool(self) -> bool:
        """Whether it is slow enough for rest relative to the tool."""
        (v_BO, w_BO), (v_BT, w_BT) = self.V_BO, self.V_BT
        p_TO_B = np.asarray(self.X_BO.translation()) - np.asarray(self.X_BT.translation())
        return _is_slow(v_BO - (v_BT + np.cross(w_BT, p_TO_B)), w_BO - w_BT)


@dataclass(frozen=True, eq=False)
class Course:
    """A rollout without its physics: the drive of the tool, the start, and the end."""

    drive: Drive
    start_s: float  # the motion before it is left out
    X_BO: Array  # (4, 4) the object, at rest at the start
    tool: Array  # (6,) the carriage at the start: forward, up, pitch and their rates
    still: Callable[[Moment], bool]
    """Whether the object is still and nothing can move it any more; after `REST_S` it counts as at rest."""
    decided: Callable[[Moment], bool]
    """Whether nothing later can change the outcome."""
    latest_s: float


@dataclass(frozen=True, eq=False)
class Readings:
    """The readings of one rollout."""

    t_s: Array  # (N,) every 20 ms
    X_BO: tuple[RigidTransform, ...]
    X_BT: tuple[RigidTransform, ...]
    is_settled: bool  # whether it ended before the time limit
    failure: str | None  # why the solver gave up

    @property
    def p_BO_m(self) -> Array:
        """(N, 3)"""
        return np.array([X.translation() for X in self.X_BO])

    @property
    def p_TO_m(self) -> Array:
        """(3,) the object in the tool frame at the end."""
        return object_in_tool_m(self.X_BT[-1], self.X_BO[-1])


class Physics(Protocol):
    """A physics engine that steps a rollout."""

    def now(self, t_s: float) -> Moment:
        """The present state, at time `t_s`."""

    def advance_to(self, t_s: float) -> None:
        """Step until `t_s`. Raises RuntimeError if the solver gives up."""


def read(physics: Physics, course: Course) -> Readings:
    """Step from the start of a course to its end.

    A solver that does not converge is noted in the readings, never raised.
    """
    now = physics.now(course.start_s)
    t_s, X_BO, X_BT = [course.start_s], [now.X_BO], [now.X_BT]
    failure, still = None, 0
    try:
        while t_s[-1] < course.latest_s:
            still = still + 1 if course.still(now) else 0
            if still == _STILL_READINGS or course.decided(now):
                break
            t = min(course.start_s + len(t_s) * READ_EVERY_S, course.latest_s)
            physics.advance_to(t)
            now = physics.now(t)
            t_s.append(t)
            X_BO.append(now.X_BO)
            X_BT.append(now.X_BT)
    except RuntimeError as error:
        failure = f"the solver failed after {t_s[-1]:.2f} s: {error}"
    return Readings(np.array(t_s), tuple(X_BO), tuple(X_BT), failure is None and t_s[-1] < course.latest_s, failure)


def object_in_tool_m(X_BT: RigidTransform, X_BO: RigidTransform) -> Array:
    """(3,) the object's place in the tool frame."""
    return np.asarray(X_BT.inverse() @ X_BO.translation())


def reading_before_s(t_s: float) -> float:
    """The last moment on the grid of readings that is not after `t_s`, nor before 0."""
    return max(0.0, math.floor(t_s / READ_EVERY_S) * READ_EVERY_S)


def _is_slow(v_m_s: Array, w_rad_s: Array) -> bool:
    """Whether velocities (3,), (3,) are slow enough for an object at rest."""
    return bool(np.linalg.norm(v_m_s) < REST_M_S) and bool(np.linalg.norm(w_rad_s) < REST_RAD_S)
