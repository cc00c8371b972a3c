"""The time that rollouts take on this computer, which is stated before they begin."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from hw.computer import usable_cores
from sim.rollouts.dataset import draw_requests
from sim.tasks.task import Task

SLOW_S = 0.5
"""A simulator is slow if a rollout takes longer than this; then learning from fewer rollouts is worthwhile."""

_TIMED, _BATCH = 3, 64
"""Rollouts that are timed: a few single ones, or one batch."""


@dataclass(frozen=True)
class RolloutCost:
    """The measured time of one rollout on one core, or its part of the time of a batch."""

    seconds: float
    in_batches: bool = False

    @property
    def is_slow(self) -> bool:
        """Whether rollouts, and not learning, decide how long a pretraining takes."""
        return self.seconds >= SLOW_S

    def in_words(self, rollouts: int, processes: int = 0) -> str:
        """The time for this number of rollouts on this computer, in words."""
        cores = 1 if self.in_batches else processes or usable_cores()
        total, where = self.seconds * rollouts / cores, "in batches" if self.in_batches else f"on {cores} cores"
        sooner = ", sooner if the error stops falling" if self.is_slow else ""
        return (
            f"a rollout takes {duration(self.seconds)}; up to {rollouts} of them {where} take about "
            f"{duration(total)}{sooner}"
        )


def measured_cost(task: Task, seed: int) -> RolloutCost:
    """The median time of a few rollouts, one after another, in this process. For a task that simulates batches, it is
    the time of one batch divided by its size.
    """
    rng, times = np.random.default_rng(seed), list[float]()
    if (simulate_many := task.simulate_many) is not None:
        batch = draw_requests(task, _BATCH, rng)
        began = time.perf_counter()
        simulate_many(batch.parameters, batch.context, batch.action, batch.nuisance)
        return RolloutCost((time.perf_counter() - began) / _BATCH, in_batches=True)
    requests = draw_requests(task, _TIMED, rng)
    for i in range(_TIMED):
        p, c, a, n = (getattr(requests, name)[i] for name in ("parameters", "context", "action", "nuisance"))
        began = time.perf_counter()
        task.simulate(p, c, a, n)
        times.append(time.perf_counter() - began)
    return RolloutCost(float(np.median(times)))


def duration(seconds: float) -> str:
    """A time for a person: "0.4 s", "12 min", "3.2 h"."""
    if seconds < 0.1:
        return f"{1e3 * seconds:.2g} ms"
    if seconds < 90.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400.0 else f"{seconds / 3600:.1f} h"
