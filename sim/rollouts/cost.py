"""The time that rollouts take on this computer, which is stated before they begin."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from hw.computer import usable_cores
from sim.rollouts.dataset import draw_requests
from sim.tasks.task import Task

SLOW_S = 0.5
"""A rollout that takes longer makes a simulator slow: it is worth to learn from fewer of them."""

_TIMED = 3


@dataclass(frozen=True)
class RolloutCost:
    """The measured time of one rollout on one core."""

    seconds: float

    @property
    def is_slow(self) -> bool:
        """Whether rollouts, and not learning, decide how long a pretraining takes."""
        return self.seconds >= SLOW_S

    def in_words(self, rollouts: int, processes: int = 0) -> str:
        """The time for this number of rollouts on this computer, in words."""
        cores = processes or usable_cores()
        total = self.seconds * rollouts / cores
        sooner = ", sooner if the error stops falling" if self.is_slow else ""
        return (
            f"a rollout takes {duration(self.seconds)}; up to {rollouts} of them on {cores} cores take about "
            f"{duration(total)}{sooner}"
        )


def measured_cost(task: Task, seed: int) -> RolloutCost:
    """The median time of a few rollouts, one after another, in this process."""
    requests = draw_requests(task, _TIMED, np.random.default_rng(seed))
    times = []
    for i in range(_TIMED):
        p, c, a, n = (getattr(requests, name)[i] for name in ("parameters", "context", "action", "nuisance"))
        began = time.perf_counter()
        if task.simulate_many is None:
            task.simulate(p, c, a, n)
        else:
            task.simulate_many(p[None], c[None], a[None], n[None])
        times.append(time.perf_counter() - began)
    return RolloutCost(float(np.median(times)))


def duration(seconds: float) -> str:
    """A time for a person: "0.4 s", "12 min", "3.2 h"."""
    if seconds < 0.1:
        return f"{1e3 * seconds:.2g} ms"
    if seconds < 90.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400.0 else f"{seconds / 3600:.1f} h"
