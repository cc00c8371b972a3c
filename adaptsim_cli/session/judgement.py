"""The simulator's judgement of stored trials, as values: predictions, errors of their ends, mean rewards."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from adaptsim_cli.session.records import SessionFacts, TrialRecord
from hw.types import Array
from sim.adaptation.posterior import Posterior
from sim.tasks import known_task
from sim.types import Estimate

Z95 = 1.96
"""Half width of the central 95 % of a normal distribution, in standard deviations."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """The simulator's prediction of one executed trial: states (k columns) at the times of an observation."""

    t_s: Array  # (M,)
    columns: tuple[int, ...]  # of the track
    guess: Array  # (M, k) for the parameters of the trial's policy
    likely: Array  # (N, M, k) for parameters drawn from the posterior after all trials


@dataclass(frozen=True)
class HeldOutScore:
    """The final policy scored by recorded trials that the session never saw."""

    trials: int  # held out
    contexts: int  # in which each policy chose among them
    final: tuple[float, float, float]  # mean reward with its 95 % interval
    udr: tuple[float, float, float]
    best: float  # of the best recorded action in hindsight: no policy can earn more
    before: float  # median error of the predicted ends, for parameters drawn from the prior
    after: float  # the same for the posterior

    @property
    def in_words(self) -> str:
        """Whether to believe the posterior, in one sentence."""
        if self.after < self.before:
            return "Believe the posterior rather than the prior: it predicts trials that it never saw better."
        return "Do not believe the posterior: it predicts trials that it never saw no better than the prior."


@dataclass(frozen=True, eq=False)
class Judgement:
    """The simulator's judgement of a session, from all of its trials."""

    posteriors: tuple[Posterior, ...]  # before the first iteration, and after each
    predictions: Mapping[int, Prediction]  # by number of the trial
    first: Estimate | None  # of the first policies, under the last posterior; None: it would cost rollouts
    adapted: Estimate | None  # of the policy at the best parameters; None without a result
    udr: Estimate | None  # of policies for all of Omega; None as for `first`
    unit: str  # of the errors of predicted ends: "mm" on the table, else that of the observed quantities
    held_out: HeldOutScore | None = None  # None: no trial was held out


def end_error(observed: Array, expected: Array, unit: str) -> float:
    """Mean distance of expected ends (N, k) from the observed one (k,): in mm of x and y, or in another unit of all."""
    columns = slice(0, 2) if unit == "mm" else slice(None)
    away = np.linalg.norm(expected[:, columns] - observed[columns], axis=1)
    return float(away.mean()) * (1e3 if unit == "mm" else 1.0)


@dataclass(frozen=True)
class MeanReward:
    """The mean reward of trials with its 95 % interval, clipped to the possible rewards."""

    mean: float
    low: float
    high: float
    trials: int


UNKNOWN_STD = 0.4
"""Standard deviation of single rewards for a task that this version does not know: almost that of a coin."""


def trial_std(task: str) -> float:
    """Standard deviation of the rewards of single trials of a task."""
    declaration = known_task(task)
    return UNKNOWN_STD if declaration is None else declaration.adaptation.trial_std


def mean_of(rewards: Sequence[float], std: float) -> MeanReward:
    """The mean of single trials with standard deviation `std`. Raises ValueError without a trial."""
    if not rewards:
        raise ValueError("no trial, so no mean")
    mean = float(np.mean(rewards))
    half = Z95 * max(std, float(np.std(rewards, ddof=1)) if len(rewards) > 1 else 0.0) / math.sqrt(len(rewards))
    return MeanReward(mean, max(0.0, mean - half), min(1.0, mean + half), len(rewards))


def iteration_means(facts: SessionFacts, trials: Sequence[TrialRecord]) -> tuple[MeanReward, ...]:
    """The mean reward of each complete iteration, from the session's own counting `trials`; before the first one is
    complete, that of its trials so far.
    """
    std, whole = trial_std(facts.task), facts.particles * facts.trials
    rewards: dict[int, list[float]] = {}
    for trial in trials:
        rewards.setdefault(trial.iteration, []).append(trial.reward)
    first = min(rewards, default=0)
    return tuple(
        mean_of(values, std) for number, values in sorted(rewards.items()) if number == first or len(values) >= whole
    )
