"""The gain that a session may still expect, and the size of its corrections, from the draws of reality."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.types import Array
from sim.adaptation.reality import Reality
from sim.rollouts.draws import cover
from sim.solvers.solver import SolvedPolicy

CONTEXTS = 16
"""Number of evenly spread contexts for all averages."""

WORTHWHILE = 0.05
"""The smallest gain of reward that is worth an iteration."""

SHARE = 0.4
"""The share of the gain of perfect knowledge that one iteration brings."""

ENOUGH, HOPELESS = 0.15, 0.4
"""A session is done below this chance of a worthwhile gain, and hopeless below this upper end of the interval.

All three were chosen on development worlds (docs/decisions/0011-one-method.md)."""


@dataclass(frozen=True, eq=False)
class Outlook:
    """The outlook of a session, for its final policy if it ended now."""

    reward: float  # expected
    ci95: tuple[float, float]  # of the expected reward, over all draws of reality
    left: float  # expected gain of reward by perfect knowledge
    likely: float  # probability that this gain exceeds `WORTHWHILE`
    gain: float  # expected gain of one more iteration
    correction: Array  # (a,) in units: mean difference between its actions and those of `for_e`
    correction_std: Array  # (a,) standard deviation over contexts

    @property
    def done(self) -> bool:
        """Whether another iteration is not worth its trials."""
        return self.hopeless or self.likely < ENOUGH

    @property
    def hopeless(self) -> bool:
        """Whether nothing in the ranges of the action is expected to work."""
        return self.ci95[1] < HOPELESS


def outlook(reality: Reality, for_e: SolvedPolicy) -> Outlook:
    """The outlook by `reality`; `for_e` is the simulator's policy for the parameters shown beside it."""
    task, answers = reality.simulators.task, reality.answers
    n = CONTEXTS if len(task.context) else 1
    contexts = cover(task.context, n, np.random.default_rng(0))
    earned = np.stack([answers.rewards(context) for context in contexts])  # (n, A, KEPT)
    chosen = earned.mean(axis=2).argmax(axis=1)
    now = earned[np.arange(n), chosen].mean(axis=0)
    most = earned.max(axis=1).mean(axis=0)
    low, high = np.quantile(now, [0.025, 0.975])
    off = answers.actions[chosen] - for_e.actions(contexts)
    left = float((most - now).mean())
    return Outlook(
        reward=float(now.mean()),
        ci95=(float(low), float(high)),
        left=left,
        likely=float((most - now > WORTHWHILE).mean()),
        gain=SHARE * left,
        correction=off.mean(axis=0),
        correction_std=off.std(axis=0),
    )
