"""How often the reward that the paper's adaptation policy learns from is anything but zero, and what it learnt from it.

    python benchmarks/sparse_signal.py --task pushing

The paper's reward is sparse: an expected reward below the task's threshold counts as zero. Over the pairs (E, target)
of the checkpoint's prospects, targets inside Omega, this prints how many reach the threshold, and for how many targets
no E does. Then the policy itself: its greedy moves for pairs drawn evenly in Omega, on emulated trajectories. Of each
parameter: the mean move (a policy that had learnt nothing but a drift would always make it), and the share of the
moves' variance that the trajectories explain, the rest being due to where E lies.
"""

from __future__ import annotations

import argparse

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.research.methods.memory import Seen, encode, networks_of
from sim.rollouts.draws import cover
from sim.tasks import get_task
from sim.tasks.task import Task


def reached(task: Task, checkpoint: Checkpoint) -> tuple[float, float, int]:
    """(share of pairs at or above the threshold, share of targets in Omega without any such E, targets)."""
    prospects = checkpoint.prospects
    assert prospects is not None
    inside = np.all((prospects.truths >= task.parameters.low) & (prospects.truths <= task.parameters.high), axis=1)
    enough = prospects.rewards[:, inside] >= task.adaptation.threshold
    return float(enough.mean()), float((~enough.any(axis=0)).mean()), int(inside.sum())


def moves(task: Task, checkpoint: Checkpoint, candidates: int, targets: int, seed: int) -> Array:
    """(candidates, targets, p) in {-1, 0, 1}: where the policy sends each E after the trials in each target."""
    rng = np.random.default_rng(seed)
    solver, network, trials = (
        checkpoint.solver,
        networks_of(checkpoint)["iteration"],
        task.adaptation.trials_per_iteration,
    )
    means = cover(task.parameters, candidates, rng)
    truths = cover(task.parameters, targets, rng)
    found = np.empty((candidates, targets, len(task.parameters)))
    for i, policy in enumerate(solver.policies(means[:, None], rng)):
        seen, goals = [], []
        for _ in range(trials):
            contexts = task.context.sample(rng, targets)
            actions = policy.actions(contexts) + task.action_noise * rng.uniform(-1.0, 1.0, (targets, len(task.action)))
            observed = solver.trajectories(truths, actions, task.nuisance.sample(rng, targets))
            placed = np.stack([task.relocate(o, c) for o, c in zip(observed, contexts, strict=True)])
            seen.append(task.observation.with_noise(placed, rng))
            goals.append(task.context.normalise(contexts))
        state = Seen(
            np.repeat(means[i][None, None], targets, axis=0),
            np.concatenate(seen, axis=-1)[:, None],
            np.concatenate(goals, axis=-1)[:, None],
            np.zeros((targets, 1, trials)),
            np.ones((targets, 1)),
            np.zeros((targets, 1)),
        )
        found[i] = network.directions(encode(task, "iteration", state))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="pushing")
    parser.add_argument("--checkpoint", default="default")
    parser.add_argument("--candidates", type=int, default=32)
    parser.add_argument("--targets", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    a = parser.parse_args()
    task = get_task(a.task)
    checkpoint = load_checkpoint(task, a.checkpoint)
    pairs, hopeless, targets = reached(task, checkpoint)
    print(f"threshold {task.adaptation.threshold:g}; {targets} targets in Omega, by the emulator")
    print(f"pairs (E, target) that reach it    {100 * pairs:5.1f} %")
    print(f"targets that no E brings there     {100 * hopeless:5.1f} %")
    found = moves(task, checkpoint, a.candidates, a.targets, a.seed)
    explained = found.var(axis=1).mean(axis=0) / np.maximum(found.var(axis=(0, 1)), 1e-12)
    print("parameter   mean move   explained by the trajectories")
    for name, drift, share in zip(task.parameters.names, found.mean(axis=(0, 1)), explained, strict=True):
        print(f"{name:<10} {drift:+9.2f}   {100 * share:5.0f} %")


if __name__ == "__main__":
    main()
