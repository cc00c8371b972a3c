"""What it was trained on, and what it meets: adaptation policies of several checkpoints on two kinds of unseen targets.

    python benchmarks/targets.py --task pendulum --checkpoints default wide

`paper` targets lie in Omega, `wide` ones also in the margin around it; OOD is what lies outside of what a policy was
trained on. Targets and judging are those of `adaptsim pretrain` (same seed), so with `--cache` on a copy of the
`rollouts` of a pretraining some are not simulated again. UDR, oracle and solver are those of the first checkpoint.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from sim.adaptation.card import MethodScore, Targets
from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.method import Method
from sim.research.methods.memory import networks_of
from sim.research.methods.q_policy import QPolicy
from sim.research.pretraining.evaluation import EvaluationSettings, evaluate
from sim.research.pretraining.meta_training import TARGETS
from sim.research.pretraining.pipeline import stage_seeds
from sim.rollouts import process_pool, run_many
from sim.rollouts.cache import CachedRollouts
from sim.rollouts.run import Roll
from sim.tasks import get_task


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    checkpoints = {name: load_checkpoint(task, name) for name in arguments.checkpoints}
    first = next(iter(checkpoints.values()))
    methods: dict[str, Method] = {
        f"{memory}, trained on {checkpoint.card.budget.meta.targets}": QPolicy(
            task, networks_of(checkpoint)[memory], memory
        )
        for checkpoint in checkpoints.values()
        for memory in arguments.memories
    }
    kinds: list[Targets] = [kind for kind in TARGETS if kind in arguments.kinds]
    print("| targets | adaptation policy | reward | gap closed | above UDR |\n|---|---|---|---|---|")
    with process_pool(arguments.workers) as executor:
        for kind in kinds:
            one: Roll = partial(run_many, task, executor=executor)
            roll: Roll = one if task.exact else CachedRollouts(task, Path(arguments.cache), executor)
            settings = EvaluationSettings(kind=kind, targets=arguments.targets)
            report = evaluate(first.solver, methods, roll, settings, stage_seeds(arguments.seed)[3])
            for score in report.methods:
                print(f"| {kind} | {row(score)}", flush=True)
            print(
                f"| {kind} | UDR; best E | {report.udr:.3f}; {report.oracle:.3f} | {report.targets_with_gap} gaps | |"
            )


def row(score: MethodScore) -> str:
    """After the last iteration."""
    (low, high), above = score.gap_closed_ci95[-1], score.above_udr_ci95
    closed = f"{score.gap_closed[-1]:.2f} ({low:.2f} to {high:.2f})"
    return f"{score.name} | {score.reward[-1]:.3f} | {closed} | {above[0]:+.3f} to {above[1]:+.3f} |"


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="pendulum")
    parser.add_argument(
        "--checkpoints", nargs="+", default=["default", "wide"], help="names of shipped ones, or folders"
    )
    parser.add_argument("--kinds", nargs="+", default=list(TARGETS), choices=TARGETS)
    parser.add_argument("--memories", nargs="+", default=["iteration", "history"])
    parser.add_argument("--targets", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cache", default="build/targets", help="folder of rollouts")
    parser.add_argument("--workers", type=int, default=None)
    return parser.parse_args()


if __name__ == "__main__":
    main()
