"""What a session may still gain, and by how much its actions are corrected: read off what may be true of reality."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.types import Array
from sim.adaptation.reality import Reality
from sim.rollouts.draws import cover
from sim.solvers.solver import SolvedPolicy

CONTEXTS = 16
"""Contexts, evenly, that everything is averaged over."""

WORTHWHILE = 0.05
"""A smaller gain of reward is not worth an iteration."""

SHARE = 0.4
"""Part of what knowing everything would add that one iteration brings."""

ENOUGH, HOPELESS = 0.15, 0.4
"""Chance of a worthwhile gain below which a session is done, and upper end of the interval below which it is hopeless.

All three were found on worlds to develop on (docs/decisions/0011-one-method.md)."""


@dataclass(frozen=True, eq=False)
class Outlook:
    """Of the policy that a session would go with now."""

    reward: float  # expected
    ci95: tuple[float, float]  # of the expected reward, over all that may be true
    left: float  # expected reward that knowing everything would add
    likely: float  # probability that it would add more than `WORTHWHILE`
    gain: float  # the part of it that one more iteration brings, on average
    correction: Array  # (a,) in units: mean difference of its actions from those of `for_e`
    correction_std: Array  # (a,) over the contexts

    @property
    def done(self) -> bool:
        """Whether another iteration is not worth its trials."""
        return self.hopeless or self.likely < ENOUGH

    @property
    def hopeless(self) -> bool:
        """Whether nothing in the ranges of the action is expected to work."""
        return self.ci95[1] < HOPELESS


def outlook(reality: Reality, for_e: SolvedPolicy) -> Outlook:
    """`for_e`: the simulator's policy for the parameters that are shown beside it."""
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
