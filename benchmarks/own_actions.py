"""The worth of an own action by the simulator: the best action of each truth compared with the best fixed rule.

For truths that fill Omega, or the margin beyond it, every action of a large set is valued in drawn contexts. The fixed
rule has one action for each context, chosen in half of the truths and scored in the other half, and the other way
round. An action of its own is the best one for each truth and context. The pendulum is exact; in the other tasks the
emulator answers, and the best of many emulated values is a little too high. Results are written to `--out`.

    python benchmarks/own_actions.py --tasks pendulum pushing scooping
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import load_checkpoint
from sim.research.benchmark.entries import fixed_policies
from sim.rollouts.draws import Disturbances, cover, varies
from sim.storage.files import whole_file
from sim.tasks import get_task
from sim.tasks.task import Solver

OUT = Path("docs/results/own-actions.json")
TRUTHS, ACTIONS, CONTEXTS, DRAWS = 128, 384, 6, 2
NEED = 0.1


def candidate_actions(solver: Solver, truths: Array, name: str) -> Array:
    """(A, a): actions that fill their ranges; for an exact task, the best ones of the truths and of a fixed rule."""
    task = solver.task
    if task.exact is None:
        return cover(task.action, ACTIONS, np.random.default_rng(0))
    nowhere = np.zeros((1, len(task.context)))
    policies = solver.policies(truths[:, None], np.random.default_rng(0))
    fixed = fixed_policies("udr-mean", load_checkpoint(get_task(name)), 0)
    best = np.concatenate([policy.actions(nowhere) for policy in (*policies, *fixed)])
    return np.asarray(np.clip(best, task.action.low, task.action.high))


def values(solver: Solver, truths: Array, actions: Array) -> Array:
    """(T, A, G) rewards, averaged over disturbances."""
    task, rng = solver.task, np.random.default_rng(1)
    contexts = task.context.sample(rng, CONTEXTS if len(task.context) else 1)
    drawn = Disturbances.evenly(task, DRAWS if varies(task) else 1, rng)
    rows = []
    for truth in truths:
        predicted = solver.outcomes(
            truth, (actions[:, None, None] + drawn.error), drawn.nuisance, task.simulated_in(contexts)[:, None]
        )
        earned = task.expected_reward(predicted, contexts[:, None])
        rows.append(earned.mean(axis=(0, 3)))
    return np.array(rows)


def summary(earned: Array) -> dict[str, float | int]:
    """Mean rewards of the best fixed rule and of each truth's own action, and how many truths gain `NEED`."""
    own = earned.max(axis=1).mean(axis=1)
    fixed = np.empty(len(earned))
    halves = np.array_split(np.random.default_rng(0).permutation(len(earned)), 2)  # every second Sobol point is alike
    for mine, others in (halves, halves[::-1]):
        rule = earned[others].mean(axis=0).argmax(axis=0)
        fixed[mine] = np.take_along_axis(earned[mine], rule[None, None], axis=1)[:, 0].mean(axis=1)
    gain = own - fixed
    return {
        "truths": len(earned),
        "fixed": round(float(fixed.mean()), 4),
        "own": round(float(own.mean()), 4),
        "in_need": int((gain >= NEED).sum()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=["pendulum", "pushing", "scooping"])
    parser.add_argument("--out", type=Path, default=OUT)
    wanted = parser.parse_args()
    stored = json.loads(wanted.out.read_text(encoding="utf-8")) if wanted.out.exists() else {}
    for name in wanted.tasks:
        solver, task = load_checkpoint(get_task(name)).solver, get_task(name)
        margin = cover(task.margin, 16 * TRUTHS, np.random.default_rng(2))
        unit = task.parameters.normalise(margin)
        beyond = margin[((unit < 0.0) | (unit > 1.0)).any(axis=1)][:TRUTHS]
        for where, truths in (("omega", cover(task.parameters, TRUTHS, np.random.default_rng(3))), ("beyond", beyond)):
            actions = candidate_actions(solver, truths, name)
            stored[f"{name} {where}"] = summary(values(solver, truths, actions))
            print(name, where, stored[f"{name} {where}"], flush=True)
    with whole_file(wanted.out) as temporary:
        temporary.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
