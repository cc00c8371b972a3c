"""How far an observed trajectory lies from anything that the simulator can produce."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hw.types import Array
from sim.rollouts.draws import Disturbances, sobol
from sim.solvers.solver import Expectations

DRAWS = 512
"""Numbers of parameters, and of nuisances with action errors, to try: they span the trajectories of one action."""

LEAST_STD = 2e-3
"""Least tolerated deviation, normalised: smaller ones are below the camera's pixels."""


def misfit(expectations: Expectations, context: Array, action: Array, observation: Array) -> float:
    """Distance of `observation` (size,) to the nearest simulated trajectory for parameters in the ranges.

    In standard deviations of camera noise and emulator error together (root mean square over the observed values):
    about 1 for a trajectory of the simulator.
    """
    task = expectations.task
    p = len(task.parameters)
    unit = sobol(DRAWS, p + len(task.action) + len(task.nuisance), np.random.default_rng(0))
    parameters, drawn = task.parameters.spread(unit[:, :p]), Disturbances.from_unit(task, unit[:, p:])
    executed = action + drawn.error
    return float(
        np.sqrt(squared_misfits(expectations, context, observation, parameters, executed, drawn.nuisance).min())
    )


@dataclass(frozen=True, eq=False)
class Misfits:
    """The misfits of a session's trials, each computed once."""

    expectations: Expectations
    _known: dict[bytes, float] = field(default_factory=dict, repr=False)

    def of(self, context: Array, action: Array, observation: Array) -> float:
        """See `misfit`."""
        key = b"".join(part.tobytes() for part in (context, action, observation))
        if key not in self._known:
            self._known[key] = misfit(self.expectations, context, action, observation)
        return self._known[key]


def squared_misfits(
    expectations: Expectations, context: Array, observation: Array, parameters: Array, executed: Array, nuisance: Array
) -> Array:
    """(N,) mean squares of that distance for (N, p), (N, a), (N, n) in units, one by one."""
    task, seen = expectations.task, expectations.task.observation
    there = task.relocate(
        expectations.trajectories(parameters, executed, nuisance), np.tile(context, (len(parameters), 1))
    )
    expected = seen.normalise(seen.denormalise(there) + seen.noise_mean)
    camera = np.tile(seen.noise_std / (seen.high - seen.low), len(seen.times_s))
    std = np.sqrt(camera**2 + expectations.residual_std**2 + LEAST_STD**2)
    return np.asarray((((expected - observation) / std) ** 2).mean(axis=1))
