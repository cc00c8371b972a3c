"""The learning gate: does an adaptation policy use what it sees?

It must earn more than staying where it starts, and more than its own mean drift, in which the observations play no
part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Targets
from sim.research.methods.q_network import QNetwork
from sim.research.methods.q_policy import MemoryName
from sim.research.pretraining.episodes import Running, Simulator, visit
from sim.research.pretraining.meta_training import sample_targets
from sim.tasks.task import Task

GATE_TARGETS = 512
"""Unseen targets, one particle each."""

_ENDS = 3
"""The last distributions of the policy, of staying and of drifting are visited once more, under equal conditions."""


def gate_visits(task: Task) -> int:
    """Number of distributions visited by the gate."""
    return GATE_TARGETS * (task.adaptation.horizon + 1 + _ENDS)


@dataclass(frozen=True)
class Gate:
    """Mean expected rewards of the last distributions of whole sessions from the same starts."""

    policy: float
    stay: float
    drift: float  # always the policy's own mean direction
    above_ci95: tuple[float, float]  # of the policy - the better of the other two, paired by target
    passed: bool  # the whole interval lies above zero


def learning_gate(
    simulator: Simulator,
    network: QNetwork,
    memory: MemoryName,
    seed: int,
    kind: Targets = "paper",
    count: int = GATE_TARGETS,
) -> Gate:
    """The policy, staying and drifting in `count` unseen targets, all in the simulator of its training."""
    task, rng = simulator.solver.task, np.random.default_rng(seed)
    targets = sample_targets(task, kind, count, rng)
    running = Running(simulator, targets, 1, rng)
    for _ in range(task.adaptation.horizon):
        running.step(network.directions(running.state(memory)))
    ran, final = running.episodes(), int(rng.integers(2**31))
    mean = np.round(ran.directions.mean(axis=(0, 1, 2))).astype(np.int_)
    start = drifted = ran.means[:, 0, 0]
    for _ in range(task.adaptation.horizon):
        drifted = task.parameters.step(drifted, mean, task.adaptation.delta)

    def earned(means: Array) -> Array:
        """(count,) with the same random draws for all three."""
        return visit(simulator, means, targets, np.random.default_rng(final)).rewards

    policy, stay, drift = (earned(means) for means in (ran.means[:, 0, -1], start, drifted))
    better = stay if stay.mean() >= drift.mean() else drift
    drawn = rng.integers(count, size=(2000, count))
    low, high = np.quantile((policy - better)[drawn].mean(axis=1), [0.025, 0.975])
    return Gate(
        float(policy.mean()), float(stay.mean()), float(drift.mean()), (float(low), float(high)), bool(low > 0.0)
    )
