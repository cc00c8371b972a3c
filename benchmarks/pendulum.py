"""The control experiment: methods on the double pendulum, every reward exact, no dataset and no emulator.

    python benchmarks/pendulum.py --seeds 3 --targets 40

Sessions as an operator's: two particles, one trial each an iteration. After every iteration the parameters that the
session would go with (`choose_best`) are judged in the target, on unseen targets in Omega and on those of Table A2.
Seeds are of targets and sessions; the adaptation policy is the checkpoint's. Intervals are bootstrapped over sessions.
The oracle of a target in Omega is that target itself, of another the best of a fine draw from Omega.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from functools import partial

import numpy as np

from hw.types import Array
from sim.adaptation.best import choose_best
from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.methods import make_method
from sim.adaptation.methods.udr import Udr
from sim.lab.world import list_worlds, load_world
from sim.research.pretraining.evaluation import EvaluationSettings, run_session
from sim.rollouts import Requests, run_many, serial_executor
from sim.rollouts.draws import sobol
from sim.solvers.misfit import misfit
from sim.solvers.solver import Solver
from sim.tasks import get_task
from sim.tasks.pendulum.lqr import optimal

FINE, BATCH = 8192, 4096


def main() -> None:
    arguments = _arguments()
    task = get_task("pendulum")
    checkpoint = load_checkpoint(task, arguments.checkpoint)
    solver, roll = checkpoint.solver, partial(run_many, task, executor=serial_executor())
    print(f"{rollouts_per_s():.0f} rollouts a second on one core")
    print(f"misfit of trials in Omega: 95 % below {misfit_quantile(solver, arguments.misfits):.1f}\n")
    omega = task.parameters.sample(np.random.default_rng(2024), arguments.targets)
    groups = {"Omega": list(omega)} | {name: [load_world(name, task).parameters] for name in list_worlds(task)}
    settings = EvaluationSettings(particles=2, iterations=arguments.iterations)
    print("| target | method | " + " | ".join(f"iteration {i + 1}" for i in range(arguments.iterations)) + " |")
    print("|---" * (arguments.iterations + 2) + "|")
    for name, targets in groups.items():
        repeats = arguments.seeds if name == "Omega" else arguments.repeats
        for label in ("adaptsim-belief", "adaptsim-iteration", "random"):
            method = make_method(label, task, checkpoint)
            curves = []
            for seed in range(repeats):
                for k, target in enumerate(targets):
                    rng = np.random.default_rng((seed, k))
                    history = run_session(solver, method, target, roll, settings, rng).history
                    best = [choose_best(task, history[: i + 1]).particle.mean for i in range(len(history))]
                    tried = [[seen.particle.mean for seen in iteration] for iteration in history]
                    curves.append((earned(solver, np.array(best), target), _mean_tried(solver, tried, target)))
            print(row(name, label, np.array([best for best, _ in curves])))
            print(row(name, f"{label}, mean of what it tried", np.array([mean for _, mean in curves])))
        udr = Udr(task).start(1, np.random.default_rng(0))[0].mean
        fixed = np.array([[earned(solver, udr[None], t)[0]] * arguments.iterations for t in targets])
        print(row(name, "udr", fixed))
        ceiling = np.ones(len(targets)) if name == "Omega" else np.array([oracle(solver, targets[0])])
        print(row(name, "oracle", np.tile(ceiling[:, None], (1, arguments.iterations))), flush=True)


def earned(solver: Solver, means: Array, target: Array) -> Array:
    """(n,) exact rewards in a target (p,) of the policies for `means` (n, p)."""
    rng, contexts = np.random.default_rng(0), solver.task.context.sample(np.random.default_rng(0), 1)
    actions = np.stack([p.actions(contexts) for p in solver.policies(means[:, None], rng)])
    return solver.expected_rewards(np.tile(target, (len(means), 1)), contexts, actions, rng)


def _mean_tried(solver: Solver, tried: Sequence[Sequence[Array]], target: Array) -> Array:
    return np.asarray(earned(solver, np.concatenate(tried), target).reshape(len(tried), -1).mean(axis=1))


def oracle(solver: Solver, target: Array) -> float:
    """Best reward of any E in Omega; its faces are drawn as well, where the best of a far target lies."""
    space = solver.task.parameters
    reach = np.clip(1.2 * sobol(FINE, len(space), np.random.default_rng(0)) - 0.1, 0.0, 1.0 - 1e-9)
    return float(earned(solver, space.spread(reach), target).max())


def row(name: str, label: str, values: Array) -> str:
    """Mean over sessions (n, iterations) with its 95 % bootstrap interval."""
    drawn = np.random.default_rng(0).integers(len(values), size=(2000, len(values)))
    low, high = np.quantile(values[drawn].mean(axis=1), [0.025, 0.975], axis=0)
    spans = zip(values.mean(axis=0), low, high, strict=True)
    return f"| {name} | {label} | " + " | ".join(f"{m:.2f} ({a:.2f} to {b:.2f})" for m, a, b in spans) + " |"


def rollouts_per_s() -> float:
    """True rollouts with the gains of random E in random targets, the best of three batches."""
    task, rng = get_task("pendulum"), np.random.default_rng(0)
    gains, _ = optimal(task.parameters.sample(rng, BATCH))
    nothing = np.zeros((BATCH, 0))
    requests = Requests(task.margin.sample(rng, BATCH), nothing, gains.reshape(BATCH, -1), nothing)
    took_s = []
    with serial_executor() as executor:
        for _ in range(3):
            began = time.process_time()
            run_many(task, requests, executor)
            took_s.append(time.process_time() - began)
    return BATCH / min(took_s)


def misfit_quantile(solver: Solver, count: int) -> float:
    """95th percentile of the misfit of trials in targets in Omega, under the gain of another E."""
    task, rng = solver.task, np.random.default_rng(1)
    targets, means = task.parameters.sample(rng, count), task.parameters.sample(rng, count)
    gains = np.stack([p(task.reference_context) for p in solver.policies(means[:, None], rng)])
    seen = solver.trajectories(targets, gains, np.zeros((count, 0)))
    context = task.reference_context
    return float(np.quantile([misfit(solver, context, k, o) for k, o in zip(gains, seen, strict=True)], 0.95))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkpoint", default="default")
    parser.add_argument("--seeds", type=int, default=3, help="sessions on each target in Omega")
    parser.add_argument("--repeats", type=int, default=12, help="sessions on each target of Table A2")
    parser.add_argument("--targets", type=int, default=40)
    parser.add_argument("--iterations", type=int, default=5)
    parser.add_argument("--misfits", type=int, default=256)
    return parser.parse_args()


if __name__ == "__main__":
    main()
