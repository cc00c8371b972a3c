"""When the training of a task policy starts from that of a nearby distribution, and with how many rollouts (paper,
A2.2).

The paper does not state the least budget. Ours (`ReuseRules.least_budget`) is a quarter of the first one. With the
numbers of Table A1 it never matters, because a policy reaches its largest budget at its fourth distribution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hw.types import Array
from sim.tasks.task import ReuseRules


@dataclass(frozen=True, eq=False)
class PolicyRecord:
    """The facts about one distribution's policy that the rules need."""

    mean: Array  # (p,) normalised; for wide distributions (2p,), see `features`
    budget: int  # rollouts of its training, those of its donors included
    distributions: int  # j: number of distributions it was trained with
    donated: bool = False  # a donor donates once, so that no policy serves too many distributions


@dataclass(frozen=True, eq=False)
class TrainingPlan:
    """The training for a new distribution, and the record with it added (last)."""

    donor: int | None  # position in the record: training starts from its weights
    budget: int  # rollouts for training; 0: use the donor's policy unchanged
    record: tuple[PolicyRecord, ...]


def features(samples: Array) -> Array:
    """Samples (m, p) of a distribution, normalised -> (2p,), means and then standard deviations.

    The distance between two of them is the 2-Wasserstein distance of two Gaussians with diagonal covariance. For narrow
    distributions it is the distance of the means, as in the paper. It also keeps a policy for all of the ranges apart
    from one for their middle.
    """
    return np.concatenate([samples.mean(axis=0), samples.std(axis=0)])


def plan_training(record: tuple[PolicyRecord, ...], mean: Array, rules: ReuseRules) -> TrainingPlan:
    """The training plan for the distribution with `mean` (p,), or `features` (2p,), normalised by the ranges.

    The nearest policy within D that has not donated yet becomes the donor. Training continues with max(M_min, alpha^(j
    - 1) M) rollouts, where j counts the new distribution, and never beyond M_max in total.
    """
    gaps = [np.inf if p.donated else float(np.linalg.norm(p.mean - mean)) for p in record]
    donor = int(np.argmin(gaps)) if gaps and min(gaps) <= rules.distance else None
    if donor is None:
        fresh = PolicyRecord(mean, rules.first_budget, 1)
        return TrainingPlan(None, rules.first_budget, (*record, fresh))
    before = record[donor]
    j = before.distributions + 1
    wanted = max(rules.least_budget, round(rules.discount ** (j - 1) * rules.first_budget))
    budget = max(0, min(wanted, rules.max_budget - before.budget))
    kept = tuple(replace(p, donated=True) if i == donor else p for i, p in enumerate(record))
    return TrainingPlan(donor, budget, (*kept, PolicyRecord(mean, before.budget + budget, j)))
