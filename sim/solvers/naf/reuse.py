"""When a task policy goes on from that of a nearby distribution, and with how many rollouts (paper, A2.2).

The paper does not give the least budget; `ReuseRules.least_budget` is ours to choose and to state: a quarter of the
first one. With the numbers of Table A1 it never binds, since a policy reaches its largest budget on its fourth visit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hw.types import Array
from sim.tasks.task import ReuseRules


@dataclass(frozen=True, eq=False)
class PolicyRecord:
    """What the rules must remember of one distribution's policy."""

    mean: Array  # (p,) normalised; for wide distributions (2p,), see `features`
    budget: int  # rollouts that went into it, those of its donors included
    distributions: int  # j: how many distributions it has been trained with
    donated: bool = False  # a donor gives once, so that no policy serves too many distributions


@dataclass(frozen=True, eq=False)
class TrainingPlan:
    """What to do for a new distribution, and the record with it added (last)."""

    donor: int | None  # position in the record: start from its weights
    budget: int  # rollouts to train with; 0: use the donor's policy as it is
    record: tuple[PolicyRecord, ...]


def features(samples: Array) -> Array:
    """Samples (m, p) of a distribution, normalised -> (2p,), means and then standard deviations.

    The distance between two of them is that between the means, as in the paper, where the distributions are narrow; it
    keeps a policy for all of the ranges apart from one for their middle. (2-Wasserstein distance of two Gaussians with
    diagonal covariance.)
    """
    return np.concatenate([samples.mean(axis=0), samples.std(axis=0)])


def plan_training(record: tuple[PolicyRecord, ...], mean: Array, rules: ReuseRules) -> TrainingPlan:
    """Rules for the distribution with `mean` (p,), or `features` (2p,), normalised by the ranges.

    The nearest policy within D that has not donated yet is taken over and trained on with
    max(M_min, alpha^(j - 1) M) rollouts, j counting the new distribution, and never beyond M_max in all.
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
