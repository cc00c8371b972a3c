"""The paper's adaptation policy with an attainable threshold, and a gate that tests whether it has learnt anything.

With the paper's threshold almost no parameters earn a reward in pushing, and from rewards that are nearly always zero
the policy learns only a drift. Here the threshold is the reward that the best E reaches almost everywhere in Omega, and
all transitions are replayed, not only the last 10,000. The episodes run in the checkpoint's own simulator: the
emulator, or the exact task. The gate tests whether the policy uses its observations: it must earn more than staying,
and more than its own mean drift. The paper's own variant stays unchanged under its own name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, save_checkpoint
from sim.adaptation.q_network import QNetwork
from sim.errors import CheckpointError
from sim.pretraining.emulated import EmulatedRolls
from sim.pretraining.episodes import EpisodeSettings, Visit, visit
from sim.pretraining.meta_training import MetaSettings, learn_from, train_adaptation
from sim.rollouts.executors import serial_executor
from sim.rollouts.run import Roll, run_many
from sim.solvers.solver import Solver

WITHIN_REACH = 0.1
"""Share of Omega in which even the best E may stay below the threshold."""

UPDATES = 10_000
"""Gradient steps on all transitions."""

GATE_TARGETS = 96
"""Unseen targets in Omega for the gate, one particle each; fewer after a shorter training."""

RENEWED = ("format", "task", "object", "fingerprint", "sha256", "interface")
"""Entries of a card that are written again when a copy is saved."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Gate:
    """The gate's result: mean expected rewards in unseen targets after a whole session, from the same starts."""

    policy: float
    stay: float
    drift: float  # always the policy's own mean direction
    above_low: float  # lower end of the 95 % interval of (policy - the better of the other two), paired by target
    passed: bool


def repair(checkpoint: Checkpoint, out: Path, seed: int, steps: int, progress: Progress) -> tuple[Path, Gate]:
    """Copy the checkpoint to `out` with the trained policy; the card states its training and the gate's result.

    `steps` adaptation steps (the paper: 10,000). Raises CheckpointError if the checkpoint cannot answer without
    simulating.
    """
    solver, task = checkpoint.solver, checkpoint.solver.task
    threshold = attainable_threshold(checkpoint)
    with serial_executor() as executor:
        rng = np.random.default_rng(seed)
        exact = partial(run_many, task, executor=executor)
        roll: Roll = EmulatedRolls(checkpoint.emulator, rng) if checkpoint.emulator else exact
        settings = MetaSettings(steps=steps)
        _, _, episodes = train_adaptation(
            solver, roll, settings, seed, lambda i, n: progress("episodes", i, n), threshold=threshold
        )
        updates = max(1, UPDATES * steps // MetaSettings().steps)
        network = learn_from(
            task, episodes, "iteration", updates, seed, lambda i, n: progress("learning", i, n), threshold
        )
        judged = max(16, min(GATE_TARGETS, GATE_TARGETS * steps // MetaSettings().steps))
        gate = learning_gate(solver, network, roll, seed + 1, judged)
    progress("gate", 1, 1)
    facts = {key: value for key, value in checkpoint.card.facts().items() if key not in RENEWED}
    learnt = {"threshold": threshold, "steps": steps, "updates": updates, "seed": seed, "gate": asdict(gate)}
    facts |= {"attainable": learnt}
    save_checkpoint(task, out, checkpoint.emulator, checkpoint.networks, facts, checkpoint.prospects, network)
    return out, gate


def attainable_threshold(checkpoint: Checkpoint) -> float:
    """The reward that the best E reaches in all of Omega except a share of `WITHIN_REACH`; at most the paper's
    threshold. Raises CheckpointError.
    """
    task, ahead = checkpoint.solver.task, checkpoint.prospects
    if ahead is None:
        raise CheckpointError(
            f"{checkpoint.path} holds no prospects, so the attainable reward is unknown: make a checkpoint with "
            f"`adaptsim pretrain --task {task.name}`"
        )
    inside = np.array([task.parameters.contains(truth) for truth in ahead.truths])
    best = ahead.rewards[:, inside].max(axis=0)
    return min(task.adaptation.threshold, round(float(np.quantile(best, WITHIN_REACH)), 3))


def learning_gate(solver: Solver, network: QNetwork, roll: Roll, seed: int, count: int = GATE_TARGETS) -> Gate:
    """Whether the policy beats staying and its own drift, in `count` unseen targets in Omega."""
    task, rng = solver.task, np.random.default_rng(seed)
    starts, targets = task.parameters.sample(rng, count), task.parameters.sample(rng, count)
    moves: list[NDArray[np.int_]] = []

    def by_policy(means: Array, seen: Visit) -> NDArray[np.int_]:
        state = np.concatenate([task.parameters.normalise(means), seen.observations], axis=-1)
        moves.append(np.asarray(network.directions(state), dtype=np.int_))
        return moves[-1]

    def always(direction: Array) -> Callable[[Array, Visit], NDArray[np.int_]]:
        return lambda means, seen: np.tile(direction.astype(np.int_), (len(means), 1))

    policy = _ended(solver, roll, starts, targets, by_policy, seed)
    mean = np.concatenate(moves).mean(axis=0)
    stay, drift = (
        _ended(solver, roll, starts, targets, always(direction), seed)
        for direction in (np.zeros(len(task.parameters)), np.round(mean))
    )
    better = stay if stay.mean() >= drift.mean() else drift
    drawn = rng.integers(count, size=(2000, count))
    low = float(np.quantile((policy - better)[drawn].mean(axis=1), 0.025))
    return Gate(float(policy.mean()), float(stay.mean()), float(drift.mean()), low, low > 0.0)


def _ended(
    solver: Solver,
    roll: Roll,
    starts: Array,
    targets: Array,
    choose: Callable[[Array, Visit], NDArray[np.int_]],
    seed: int,
) -> Array:
    """(count,) expected rewards of the particles' final places after a whole session."""
    task, rng, means = solver.task, np.random.default_rng(seed), starts
    for _ in range(task.adaptation.horizon):
        seen = visit(solver, roll, means, targets, rng, EpisodeSettings())
        means = task.parameters.step(means, choose(means, seen), task.adaptation.delta)
    return visit(solver, roll, means, targets, rng, EpisodeSettings()).rewards
