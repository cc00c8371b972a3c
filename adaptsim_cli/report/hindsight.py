"""What the simulator makes of a session afterwards: values that a report draws; `wiring.hindsight` computes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hw.types import Array
from sim.adaptation.posterior import Posterior, Prospect


@dataclass(frozen=True, eq=False)
class Prediction:
    """What the simulator expects of one executed trial: states (k columns) at the times of an observation."""

    t_s: Array  # (M,)
    columns: tuple[int, ...]  # of the track
    guess: Array  # (M, k) with the parameters that the trial's policy was trained for
    likely: Array  # (N, M, k) with parameters drawn from the posterior after all trials


@dataclass(frozen=True, eq=False)
class Judgement:
    """What the simulator says of a session, all of its trials known."""

    posteriors: tuple[Posterior, ...]  # before the first iteration, and after each
    predictions: Mapping[int, Prediction]  # by number of the trial
    first: Prospect  # of the first policies, under the last posterior
    adapted: Prospect | None  # of the policy at the best parameters; None without a result
    udr: Prospect  # of policies for all of Omega
