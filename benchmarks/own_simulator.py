"""Ways to adapt a task of one file, with the same trials: scipy's, mujoco.sysid's, ours with and without Phase 1, and
others.

    adaptsim pretrain --task glide.py --budget small         # in a folder with the page's glide.py and scene.xml
    python benchmarks/own_simulator.py glide.py [--worlds wd tilted] [--seeds 3] [--budget 8] [--methods ...]
        [--out rows.jsonl] [--limit 900]

Prints, for each way and world, the mean reward of its final policy by true rollouts in the world, with the lowest and
the highest of the seeds, and the rollouts that it simulated. Sessions that are in `--out` are not run again, and none
begins after `--limit` seconds. The checkpoint is the newest one of the task. `scipy` and `mujoco-sysid` are a script as
a student would write it: the parameters that fit all trajectories best, by `scipy.optimize.least_squares` or by
`mujoco.sysid.optimize` (`pip install "mujoco[sysid]"`), and the best of 64 simulated actions there.
"""

from __future__ import annotations

import argparse
import inspect
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from kept import Kept
from scipy.optimize import least_squares

from adaptsim_cli.bench.checkpoints import usual_checkpoint
from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, load_checkpoint
from sim.adaptation.method import Iteration, Method, Particle, Simulating, trials_in
from sim.adaptation.methods import make_method
from sim.lab.world import load_world
from sim.research.benchmark.jobs import simulations
from sim.research.benchmark.sessions import Conditions, estimated_reward, mean_of, run_session, udr_policies
from sim.research.benchmark.trial_sources import SimulatedTrials
from sim.rollouts.draws import cover
from sim.rollouts.executors import serial_executor
from sim.rollouts.kept import KeptRollouts
from sim.rollouts.run import Requests, Rollouts
from sim.tasks import task_of_file
from sim.tasks.task import Executable, SolvedPolicy, Task
from sim.types import Estimate

Residuals = Callable[[Array], Array]
"""Parameters (p,), normalised by their ranges -> residuals (r,)."""

STEP, EVALUATIONS = 0.02, 20
"""Step of a difference quotient, and most steps of a fit."""

ACTIONS, JUDGED = 64, 32


def scipy_fit(residuals: Residuals, start: Array) -> Array:
    """The best parameters by scipy."""
    return np.asarray(least_squares(residuals, start, bounds=(0, 1), diff_step=STEP, max_nfev=EVALUATIONS).x)


def mujoco_fit(residuals: Residuals, start: Array) -> Array:
    """The best parameters by MuJoCo's toolbox for system identification."""
    from mujoco import sysid  # noqa: PLC0415 - only this way needs it

    def residual(unit: Array, parameters: Any) -> tuple[list[Array], None, None]:
        columns = [residuals(column) for column in unit.reshape(len(start), -1).T]
        return [np.stack(columns, axis=-1) if unit.ndim == 2 else columns[0]], None, None

    one = sysid.ParameterDict({"unit": sysid.Parameter("unit", start, np.zeros_like(start), np.ones_like(start))})
    fit, _ = sysid.optimize(one, residual, verbose=False, max_iters=EVALUATIONS, eps=STEP)
    return np.asarray(fit.as_vector())


FITS = {"scipy": scipy_fit, "mujoco-sysid": mujoco_fit}
METHODS = ("udr", *FITS, "direct", "random", "bo", "sysid-bayes", "adaptsim")


@dataclass(frozen=True, eq=False)
class ListedPolicy:
    """The simulated action that earns most in a context."""

    script: FittingScript
    parameters: Array  # (p,)
    listed: Array  # (A, a)

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a)"""
        return self.listed[[int(self._rewards(context).argmax()) for context in contexts]]

    def __call__(self, context: Array) -> Array:
        """(c,) -> (a,)"""
        return np.asarray(self.actions(context[None])[0])

    def predict(self, context: Array) -> tuple[float, float, float]:
        """The reward of the best action."""
        best = float(self._rewards(context).max())
        return best, best, best

    def _rewards(self, context: Array) -> Array:
        contexts = np.tile(context, (len(self.listed), 1))
        rollouts = self.script.simulated(self.parameters, contexts, self.listed)
        return rollouts.rewards(self.script.task, contexts)


class FittingScript:
    """A student's script: fit the parameters to all trajectories, then take the best of the simulated actions."""

    def __init__(self, task: Task, fit: Callable[[Residuals, Array], Array]) -> None:
        self.task, self.fit, self.roll = task, fit, KeptRollouts(task, serial_executor())

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The middle of the ranges."""
        return (Particle(self.task.parameters.middle[None]),) * n

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The best fit to all trajectories."""
        trials = trials_in(history)
        contexts = np.stack([trial.context for trial in trials])
        actions = np.stack([trial.action for trial in trials])
        observed = np.concatenate([trial.observation for trial in trials])

        def residuals(unit: Array) -> Array:
            rollouts = self.simulated(self.task.parameters.denormalise(unit), contexts, actions)
            return np.asarray(rollouts.observation.ravel() - observed)

        fit = self.fit(residuals, np.full(len(self.task.parameters), 0.5))
        return (Particle(self.task.parameters.denormalise(fit)[None]),) * len(history[-1])

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The best of the actions at these parameters."""
        return ListedPolicy(self, particle.mean, cover(self.task.action, ACTIONS, np.random.default_rng(0)))

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The policy of the last fit."""
        return self.policy(self.next(history, np.random.default_rng(0))[0], history)

    def simulated(self, parameters: Array, contexts: Array, actions: Array) -> Rollouts:
        """Rollouts of actions (N, a) at contexts (N, c) and parameters (p,). A context moves things only if the
        simulation takes it.
        """
        task, n = self.task, len(actions)
        reference = np.tile(np.asarray(task.reference_context), (n, 1))
        where = contexts if task.relocate is None else reference
        return self.roll(Requests(np.tile(parameters, (n, 1)), where, actions, np.tile(task.nuisance.middle, (n, 1))))


def session(name: str, checkpoint: Checkpoint, world: str, seed: int, conditions: Conditions) -> dict[str, Any]:
    """One session: rewards of the policies after the first and the last iteration, and rollouts simulated for it."""
    solver, task, began = checkpoint.solver, checkpoint.solver.task, time.perf_counter()
    source = SimulatedTrials(solver, load_world(world, task))

    def score(policy: SolvedPolicy) -> Estimate:
        return estimated_reward(task, policy.actions, source, conditions, seed)

    rollouts = simulations(name, checkpoint) if name not in FITS else 0
    if name == "udr":
        first = last = mean_of([score(policy) for policy in udr_policies(solver, seed)])
    else:
        method: Method = FittingScript(task, FITS[name]) if name in FITS else make_method(name, task, checkpoint)
        policies = run_session(solver, method, source, conditions, seed)
        first, last = score(policies[0]), score(policies[-1])
        if isinstance(method, FittingScript):
            rollouts = method.roll.simulated
        elif isinstance(method, Simulating):
            rollouts = method.rollouts.simulated
    return {
        "first": first.mean,
        "final": last.mean,
        "ci95": [last.low, last.high],
        "rollouts": rollouts,
        "wall_s": round(time.perf_counter() - began, 1),
    }


def line(way: str, world: str, rows: Sequence[dict[str, Any]]) -> str:
    """A row of the table."""
    first, final, rollouts = (np.array([row[name] for row in rows]) for name in ("first", "final", "rollouts"))
    spread = f"{final.min():.3f} to {final.max():.3f}"
    mean = f"{first.mean():8.3f} {final.mean():8.3f}"
    return f"{way:13} {world:10} {len(rows):5} {mean} {spread:>16} {rollouts.mean():10.0f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--worlds", nargs="+", default=["wd", "tilted"])
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--budget", type=int, default=8)
    parser.add_argument("--judged", type=int, default=JUDGED)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--limit", type=float, default=math.inf, help="seconds after which no session begins")
    asked = parser.parse_args()
    began, task = time.perf_counter(), task_of_file(asked.file)
    checkpoint = load_checkpoint(task, usual_checkpoint(task))
    conditions, kept = Conditions(asked.budget, judged=asked.judged), Kept(asked.out)
    print(f"lines of the student's script: {len(inspect.getsource(FittingScript).splitlines())}")
    print(f"'first': after one iteration, 'final': after {asked.budget} trials; then lowest and highest of the seeds")
    print(f"{'way':13} {'world':10} {'seeds':>5} {'first':>8} {'final':>8} {'seeds lie in':>16} {'rollouts':>10}")
    for name in asked.methods:
        for world in asked.worlds:
            rows = []
            for seed in range(asked.seeds):
                case = f"{task.name} {world} {name} {asked.budget} {asked.judged} {checkpoint.card.sha256[:12]}"
                if kept.knows(case, seed) or time.perf_counter() - began < asked.limit:
                    rows.append(kept.row(case, seed, partial(session, name, checkpoint, world, seed, conditions)))
            if rows:
                print(line(name, world, rows), flush=True)


if __name__ == "__main__":
    main()
