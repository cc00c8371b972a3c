"""Finds the parameters that a session can identify, from the errors that remain after simulated sessions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hw.types import Array
from sim.adaptation.method import Trial
from sim.adaptation.outcome_posterior import OutcomePosterior, PosteriorPolicy
from sim.adaptation.simulators import Simulators
from sim.rollouts.draws import Disturbances

SESSIONS, TRIALS = 24, 8
"""Number of simulated targets in Omega, and trials of each with the first policy."""

SETTLES, PARTLY = 0.5, 0.85
"""A parameter settles, or settles in part, if its error after a session is below this fraction of the error without
trials."""


def errors_left(simulators: Simulators, seed: int, progress: Callable[[int, int], None] | None = None) -> Array:
    """(p,) the error of each parameter after a session, as a fraction of the error before it; 1 if trials are
    uninformative.

    It follows from the weights after trials of simulated targets (`sim.adaptation.outcome_posterior`).
    """
    task, rng = simulators.task, np.random.default_rng(seed)
    policy = PosteriorPolicy(OutcomePosterior(simulators, ()))
    unit = task.parameters.normalise(simulators.truths)
    before, after = [], []
    for i, target in enumerate(task.parameters.sample(rng, SESSIONS)):
        truth = task.parameters.normalise(target)
        weights = OutcomePosterior(simulators, _trials(simulators, policy, target, rng)).weights
        before.append(unit.mean(axis=0) - truth)
        after.append(weights @ unit - truth)
        if progress is not None:
            progress(i + 1, SESSIONS)
    return np.asarray(np.sqrt(np.mean(np.square(after), axis=0) / np.mean(np.square(before), axis=0)))


def _trials(
    simulators: Simulators, policy: PosteriorPolicy, target: Array, rng: np.random.Generator
) -> tuple[Trial, ...]:
    """The trials of a session, with the emulator at `target` in place of the real object."""
    task, solver = simulators.task, simulators.solver
    contexts = task.context.sample(rng, TRIALS)
    actions, drawn = policy.actions(contexts), Disturbances.at_random(task, TRIALS, rng)
    where, executed = np.tile(target, (TRIALS, 1)), actions + drawn.error
    predicted = solver.outcomes(where, executed, drawn.nuisance, contexts).mean_of_ensemble
    paths = solver.trajectories(where, executed, drawn.nuisance, contexts)
    paths = paths + solver.residual_std * rng.standard_normal(paths.shape)
    observations = task.observation.with_noise(paths, rng)
    ends = [
        e if rng.random() < chance else None for e, chance in zip(predicted.end_state, predicted.success, strict=True)
    ]
    failed = np.zeros(TRIALS) if predicted.failure_reward is None else predicted.failure_reward
    earned = [
        float(f if e is None else task.reward_of_success(e, c)) for e, c, f in zip(ends, contexts, failed, strict=True)
    ]
    rows = zip(contexts, actions, observations, earned, ends, strict=True)
    return tuple(Trial(c, a, o, r, e) for c, a, o, r, e in rows)


def in_words(left: float) -> str:
    """A word for how well a session identifies a parameter, from the fraction of its error that remains."""
    if left < SETTLES:
        return "found within a session"
    return "found in part" if left < PARTLY else "stays unknown: other parameters explain the same trials"
