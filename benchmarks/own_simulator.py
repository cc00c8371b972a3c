"""Ways to adapt the puck of the guide's page "Your own simulator", with the same trials: scipy's, ours with and without
Phase 1, and others.

    adaptsim pretrain --task glide.py --budget small         # in a folder with the page's glide.py and scene.xml
    python benchmarks/own_simulator.py glide.py [--worlds wd tilted] [--seeds 3] [--budget 8] [--methods ...]

Prints, for each way, the mean reward of its final policy over worlds and seeds by true rollouts in the world, and the
rollouts that it simulated. The checkpoint is the newest one of the task. `scipy` is a script as a student would write
it: least squares for the parameters, and a search among simulated actions.
"""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from adaptsim_cli.bench.checkpoints import usual_checkpoint
from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.adaptation.method import Iteration, Method, Particle, Simulating, trials_in
from sim.adaptation.methods import make_method
from sim.lab.world import load_world
from sim.research.benchmark.jobs import simulations
from sim.research.benchmark.sessions import Conditions, estimated_reward, run_session, udr_policies
from sim.research.benchmark.trial_sources import SimulatedTrials
from sim.rollouts.draws import cover
from sim.rollouts.executors import serial_executor
from sim.rollouts.kept import KeptRollouts
from sim.rollouts.run import Requests
from sim.tasks import task_of_file
from sim.tasks.task import Executable, SolvedPolicy, Task

SCIPY = "scipy"
METHODS = ("udr", SCIPY, "direct", "random", "bo", "sysid-bayes", "adaptsim")
JUDGED = 32


@dataclass(frozen=True, eq=False)
class ListedPolicy:
    """The simulated action that earns most in a context."""

    task: Task
    listed: Array  # (A, a)
    ends: Array  # (A, k)

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a)"""
        rewards = self.task.reward_of_success(self.ends[:, None], contexts[None])
        return np.asarray(self.listed[rewards.argmax(axis=0)])

    def __call__(self, context: Array) -> Array:
        """(c,) -> (a,)"""
        return np.asarray(self.actions(context[None])[0])

    def predict(self, context: Array) -> tuple[float, float, float]:
        """The reward of the best action."""
        best = float(self.task.reward_of_success(self.ends, context).max())
        return best, best, best


class ScipyMethod:
    """A student's script: fit by `scipy.optimize.least_squares`, then the best of 64 simulated actions."""

    def __init__(self, task: Task) -> None:
        self.task, self.roll = task, KeptRollouts(task, serial_executor())

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The middle of the ranges."""
        return (Particle(self.task.parameters.middle[None]),) * n

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The best fit to all trajectories."""
        trials = trials_in(history)
        actions = np.array([trial.action for trial in trials])
        observed = np.concatenate([trial.observation for trial in trials])

        def residuals(unit: Array) -> Array:
            return np.asarray(
                self.simulated(self.task.parameters.denormalise(unit), actions).observation.ravel() - observed
            )

        fit = least_squares(
            residuals, np.full(len(self.task.parameters), 0.5), bounds=(0, 1), diff_step=0.02, max_nfev=20
        )
        return (Particle(self.task.parameters.denormalise(fit.x)[None]),) * len(history[-1])

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The best of 64 actions at these parameters."""
        listed = cover(self.task.action, 64, np.random.default_rng(0))
        return ListedPolicy(self.task, listed, self.simulated(particle.mean, listed).end_state)

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The policy of the last fit."""
        return self.policy(self.next(history, np.random.default_rng(0))[0], history)

    def simulated(self, parameters: Array, actions: Array):  # type: ignore[no-untyped-def]
        """Rollouts of actions (N, a) at parameters (p,)."""
        task, n = self.task, len(actions)
        reference = np.tile(np.asarray(task.reference_context), (n, 1))
        return self.roll(
            Requests(np.tile(parameters, (n, 1)), reference, actions, np.tile(task.nuisance.middle, (n, 1)))
        )


def measured(
    name: str, checkpoint: Checkpoint, world: str, seed: int, conditions: Conditions
) -> tuple[float, float, int]:
    """Rewards of the final policy and of that after the first iteration, and rollouts simulated for it."""
    solver, task = checkpoint.solver, checkpoint.solver.task
    source = SimulatedTrials(solver, load_world(world, task))

    def score(policy: SolvedPolicy) -> float:
        return estimated_reward(task, policy.actions, source, conditions, seed).mean

    if name == "udr":
        mean = float(np.mean([score(policy) for policy in udr_policies(solver, seed)]))
        return mean, mean, simulations(name, checkpoint)
    method: Method = ScipyMethod(task) if name == SCIPY else make_method(name, task, checkpoint)
    first, *_, last = run_session(solver, method, source, conditions, seed)
    if isinstance(method, ScipyMethod):
        rollouts = method.roll.simulated
    else:
        rollouts = method.rollouts.simulated if isinstance(method, Simulating) else simulations(name, checkpoint)
    return score(last), score(first), rollouts


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--worlds", nargs="+", default=["wd", "tilted"])
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--budget", type=int, default=8)
    asked = parser.parse_args()
    task = task_of_file(asked.file)
    checkpoint = load_checkpoint(task, usual_checkpoint(task))
    conditions = Conditions(asked.budget, judged=JUDGED)
    print(f"lines of the way `scipy`: {len(inspect.getsource(ScipyMethod).splitlines())}")
    print(f"means of {asked.seeds} seeds; 'first': after one iteration, 'final': after {asked.budget} trials")
    print(f"{'way':12} {'world':10} {'first':>8} {'final':>8} {'rollouts':>10}")
    for name in asked.methods:
        for world in asked.worlds:
            rows = np.array([measured(name, checkpoint, world, seed, conditions) for seed in range(asked.seeds)])
            last, first, rollouts = rows.mean(axis=0)
            print(f"{name:12} {world:10} {first:8.3f} {last:8.3f} {rollouts:10.0f}", flush=True)


if __name__ == "__main__":
    main()
