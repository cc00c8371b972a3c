"""The evaluation of a session in hindsight: values for the report, computed by `wiring.hindsight`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from adaptsim_cli.report.measured import Measured
from hw.types import Array
from sim.adaptation.posterior import Posterior, Prospect


@dataclass(frozen=True, eq=False)
class Prediction:
    """The simulator's prediction of one executed trial: states (k columns) at the times of an observation."""

    t_s: Array  # (M,)
    columns: tuple[int, ...]  # of the track
    guess: Array  # (M, k) for the parameters of the trial's policy
    likely: Array  # (N, M, k) for parameters drawn from the posterior after all trials


@dataclass(frozen=True)
class HeldOut:
    """The final policy judged by recorded trials that the session never saw."""

    trials: int  # held out
    contexts: int  # in which each policy chose among them
    final: Measured
    udr: Measured
    best: float  # of the best recorded action in hindsight: no policy can earn more
    before: float  # mean error of the predicted ends, for parameters drawn from the prior
    after: float  # the same for the posterior


@dataclass(frozen=True, eq=False)
class Judgement:
    """The simulator's judgement of a session, from all of its trials."""

    posteriors: tuple[Posterior, ...]  # before the first iteration, and after each
    predictions: Mapping[int, Prediction]  # by number of the trial
    first: Prospect  # of the first policies, under the last posterior
    adapted: Prospect | None  # of the policy at the best parameters; None without a result
    udr: Prospect  # of policies for all of Omega
    is_place: bool  # whether errors are distances on the table
    held_out: HeldOut | None = None  # None: no trial was held out
