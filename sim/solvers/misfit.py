"""The distance of an observed trajectory from all trajectories that the simulator can produce."""

from __future__ import annotations

import numpy as np

from hw.types import Array
from sim.rollouts.draws import Disturbances, sobol
from sim.tasks.task import Expectations

DRAWS = 512
"""Number of parameter vectors to try, and of nuisances with action errors. Together they span the trajectories of one
action."""

LEAST_STD = 2e-3
"""Least tolerated deviation, normalised: smaller ones are below the camera's pixels."""

VALUES, FREEDOM = 4.0, 2.0
"""The number of independent values that a trajectory counts for, and the degrees of freedom of Student's t for their
errors.

The values' errors are correlated, and an outlier that no parameters explain must not decide between parameters."""


def misfit(expectations: Expectations, context: Array, action: Array, observation: Array) -> float:
    """Distance of `observation` (size,) to the nearest simulated trajectory for parameters in the ranges.

    In standard deviations of camera noise and emulator error together (root mean square over the observed values):
    about 1 for a trajectory of the simulator.
    """
    task = expectations.task
    p = len(task.parameters)
    unit = sobol(DRAWS, p + len(task.action) + len(task.nuisance), np.random.default_rng(0))
    parameters, drawn = task.parameters.spread(unit[:, :p]), Disturbances.from_unit(task, unit[:, p:])
    contexts = np.broadcast_to(context, (DRAWS, len(task.context)))
    paths = expectations.trajectories(parameters, action + drawn.error, drawn.nuisance, contexts)
    return float(np.sqrt(squares(expectations, observation, paths).min()))


def observed_share(observation: Array) -> float:
    """The share of the values of an observation (size,) that are not missing (NaN)."""
    return float(np.isfinite(observation).mean())


def squares(expectations: Expectations, observation: Array, paths: Array) -> Array:
    """(...,) mean squares of the misfit to expected trajectories (..., size) in the same context.

    The mean is over the observed values; missing ones (NaN) are left out, and the result is 0 if all are missing.
    """
    off = offsets(expectations, observation, paths)
    return np.asarray((off**2).mean(axis=-1)) if off.shape[-1] else np.zeros(off.shape[:-1])


def offsets(expectations: Expectations, observation: Array, paths: Array) -> Array:
    """(..., observed) expected minus observed values, in standard deviations; arguments as for `squares`."""
    sight = expectations.task.observation
    expected = sight.normalise(sight.denormalise(paths) + sight.noise_mean)
    shown = np.isfinite(observation)
    return np.asarray((expected[..., shown] - observation[shown]) / tolerance(expectations)[shown])


def tolerance(expectations: Expectations) -> Array:
    """(size,) standard deviation of camera noise and emulator error together, normalised."""
    observation = expectations.task.observation
    camera = np.tile(observation.noise_std / (observation.high - observation.low), len(observation.times_s))
    return np.sqrt(camera**2 + expectations.residual_std**2 + LEAST_STD**2)


def log_likelihood(squared: Array, observed: float) -> Array:
    """(..., D) mean squares for D draws -> (...,) log-likelihood of a trajectory, up to a constant.

    `observed` is the share of its values that are not missing. If all are missing, all parameters are equally likely.
    """
    values = VALUES * observed
    if values == 0.0:
        return np.zeros(squared.shape[:-1])
    density = (1.0 + values * squared / FREEDOM) ** (-(FREEDOM + values) / 2.0)
    return np.asarray(np.log(density.mean(axis=-1)))
