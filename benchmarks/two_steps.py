"""A longer step from some time on, in place of the fixed one of training.

Most of the numerical error of a rollout arises at the impact; afterwards longer steps do. The state moves to a second
plant, because the step of a plant in Drake is fixed. `rollouts.py --all` measures it. It is not used anywhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from unittest.mock import patch

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame

from sim.tasks.shared.direct import Stepped
from sim.tasks.shared.readings import Course, Moment, Readings, read
from sim.tasks.task import SceneBodies, Task

MOVED_M = 0.001
"""An object that is farther from its start than this has been hit."""

Build = Callable[[MultibodyPlant, Frame], SceneBodies]


@dataclass(frozen=True)
class Later:
    """A step of `step_s` from `delay_s` after the impact on."""

    delay_s: float
    step_s: float


@contextmanager
def stepping(task: Task, later: Later) -> Iterator[None]:
    """Rollouts of `task` in this process have two steps."""
    rollout = import_module(f"sim.tasks.{task.name}.rollout")
    with patch.object(rollout, "run", partial(_run, later)):
        yield


def _run(later: Later, course: Course, build: Build, dt_s: float) -> Readings:
    return read(_TwoSteps(later, course, build, dt_s), course)


class _TwoSteps:
    """Drake with two steps, as `sim.tasks.shared.readings.Physics`."""

    def __init__(self, later: Later, course: Course, build: Build, dt_s: float) -> None:
        self._later, self._course, self._build = later, course, build
        self._physics = Stepped.at_start(course, build, dt_s)
        self._t_s, self._hit_s, self._is_late = course.start.t_s, np.inf, False

    def now(self, t_s: float) -> Moment:
        return self._physics.now(t_s)

    def advance_to(self, t_s: float) -> None:
        p_BO_m = self._physics.now(self._t_s).X_BO.translation()
        if np.linalg.norm(p_BO_m - self._course.start.X_BO[:3, 3]) > MOVED_M:
            self._hit_s = min(self._hit_s, self._t_s)
        if not self._is_late and self._t_s >= self._hit_s + self._later.delay_s:
            self._switch()
        self._physics.advance_to(t_s)
        self._t_s = t_s

    def _switch(self) -> None:
        """Go on from the present state with the longer step."""
        before, step_s = self._physics, self._later.step_s
        after = Stepped.at_start(self._course, self._build, step_s)
        context = after.simulator.get_mutable_context()
        context.SetTime(self._t_s - step_s / 2)
        q_and_v = before.plant.GetPositionsAndVelocities(
            before.plant.GetMyContextFromRoot(before.simulator.get_context())
        )
        after.plant.SetPositionsAndVelocities(after.plant.GetMyMutableContextFromRoot(context), q_and_v)
        self._physics, self._is_late = after, True
