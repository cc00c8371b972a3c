"""How often is it right to stop after two iterations, and to go on after one? Whole sessions of adaptsim in a set's
worlds.

    python benchmarks/stopping.py --task pushing --targets drawn-3            forty worlds that a rule drew
    adaptsim world-tables --task pushing --targets drawn
    python benchmarks/stopping.py --task pushing --targets drawn --tables      looked up: many times faster
    python benchmarks/stopping.py --task pushing --stored                      the stored sessions, without running any

A session goes on after its first iteration, which is right where the second one gained more than 0.05. From then on it
says stop, unless the latest iteration refuted its policy; which is wrong where the next iteration gained more than 0.05
after all. These are base rates, after each iteration; beside them are those of sessions with a predicted reward below
`LOW`, and of those with a refuted policy. A session that ends under 0.2 should have said "hopeless", and one that ends
above 0.3 should not. Rewards come from true rollouts, or from the half of a table that no trial sees.

Every iteration is a line of docs/results/stopping.csv. Sessions that are there do not run again.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
from world_sources import source_in

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.judging import final_policy
from sim.adaptation.method import ENOUGH, REFUTED, WORTHWHILE, policy_of
from sim.adaptation.methods.adaptsim import AdaptSim, create, forecast_after
from sim.research.benchmark.sessions import Conditions, estimated_reward, run_iterations
from sim.research.benchmark.worlds import BenchmarkWorld, targets_of
from sim.solvers.solver import policy_for
from sim.storage.files import whole_file
from sim.tasks import get_task
from sim.tasks.task import Task

STORED = Path("docs/results/stopping.csv")

LOW = 0.7
"""A predicted reward below which another iteration might be worth more."""

POOR, LITTLE = 0.3, 0.2
"""What a session earns that was wrongly called hopeless, and one that should have been."""


@dataclass(frozen=True)
class AfterIteration:
    """A session after one of its iterations: a line of the stored table."""

    task: str
    world: str
    seed: int
    iteration: int  # from 1
    predicted: float  # mean reward of the leading particle's trials in this iteration, before them
    earned: float  # mean reward of these trials
    expected: float  # of the final policy
    low: float  # end of its 95 % interval
    high: float
    hopeless: bool
    reward: float  # of the final policy, by rollouts that no trial sees

    @property
    def is_refuted(self) -> bool:
        """Whether this iteration refuted its policy, so that the session goes on."""
        return self.iteration >= ENOUGH and self.earned < REFUTED * self.predicted


Session = Sequence[AfterIteration]
"""All iterations of one session, in order."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="pushing")
    parser.add_argument("--targets", default="drawn", help="worlds: a set, or names")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tables", action="store_true", help="look trials and scores up")
    parser.add_argument("--stored", action="store_true", help="run nothing, count all stored sessions of the task")
    asked = parser.parse_args()
    if asked.stored:
        print("\n".join(counts(sessions_of(asked.task, read()))))
        return
    task, played = get_task(asked.task), list[Session]()
    for target in targets_of(task, asked.targets.split(",")):
        sessions = [s for s in sessions_of(asked.task, read()) if (s[0].world, s[0].seed) == (target.name, asked.seed)]
        if not sessions:
            sessions = [tuple(play(task, target, asked.seed, tables=asked.tables))]
            write([*read(), *sessions[0]])
        last = sessions[0][-1]
        print(
            f"{target.name:>12}: earned {', '.join(f'{one.reward:.2f}' for one in sessions[0])}; at the end expected "
            f"{last.expected:.2f} ({last.low:.2f} to {last.high:.2f}), {'hopeless' if last.hopeless else ''}",
            flush=True,
        )
        played += sessions
    print("\n".join(counts(played)))


def play(task: Task, target: BenchmarkWorld, seed: int, *, tables: bool) -> Iterator[AfterIteration]:
    """One session in a world."""
    conditions, checkpoint = Conditions(budget=10 if task.exact else 20), load_checkpoint(task)
    solver, method = checkpoint.solver, create(task, checkpoint)
    place = source_in(target, solver, tables=tables)
    assert checkpoint.reward_table is not None
    for_e = policy_for(solver, checkpoint.reward_table.candidates[:1])
    for history in run_iterations(solver, AdaptSim(method.simulators), place, conditions, seed):
        leading = history[-1][0]
        policy = policy_of(method, solver, leading.particle, history[:-1])
        predicted = float(np.mean([policy.predict(trial.context)[0] for trial in leading.trials]))
        forecast = forecast_after(method.outcome_posterior(history), for_e, len(history))
        final = final_policy(method, solver, task, history)
        yield AfterIteration(
            task=task.name,
            world=target.name,
            seed=seed,
            iteration=len(history),
            predicted=round(predicted, 4),
            earned=round(float(np.mean([trial.reward for trial in leading.trials])), 4),
            expected=round(forecast.reward, 4),
            low=round(forecast.ci95[0], 4),
            high=round(forecast.ci95[1], 4),
            hopeless=forecast.hopeless,
            reward=round(estimated_reward(task, final.actions, place, conditions, seed).mean, 4),
        )


def read() -> list[AfterIteration]:
    """All stored iterations."""
    if not STORED.exists():
        return []
    with STORED.open(encoding="utf-8", newline="") as file:
        return [
            AfterIteration(
                task=line["task"],
                world=line["world"],
                seed=int(line["seed"]),
                iteration=int(line["iteration"]),
                predicted=float(line["predicted"]),
                earned=float(line["earned"]),
                expected=float(line["expected"]),
                low=float(line["low"]),
                high=float(line["high"]),
                hopeless=line["hopeless"] == "True",
                reward=float(line["reward"]),
            )
            for line in csv.DictReader(file)
        ]


def write(iterations: Iterable[AfterIteration]) -> None:
    """Store iterations instead of those that are there."""
    with whole_file(STORED) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(field.name for field in fields(AfterIteration))
        out.writerows(map(astuple, iterations))


def sessions_of(task: str, iterations: Iterable[AfterIteration]) -> list[Session]:
    """The sessions of a task."""
    mine = [one for one in iterations if one.task == task]
    return [tuple(session) for _, session in groupby(mine, key=lambda one: (one.world, one.seed))]


def counts(sessions: Sequence[Session]) -> Iterator[str]:
    """All that the sessions said, against what came: the lines of a page."""
    yield "| after iteration | sessions | chances | the next gained more than 0.05 | lost more than 0.05 |"
    yield "|---" * 5 + "|"
    chances = [(now, after.reward - now.reward) for s in sessions for now, after in pairwise(s) if not now.hopeless]
    numbers = sorted({now.iteration for now, _ in chances})
    for name, included in [*((str(n), {n}) for n in numbers), (f"{ENOUGH} and later", set(numbers) - {1})]:
        for kind, counts_here in (
            ("all", lambda now: True),
            (f"predicted reward below {LOW}", lambda now: now.expected < LOW),
            ("policy refuted", lambda now: now.is_refuted),
        ):
            change = np.array([off for now, off in chances if now.iteration in included and counts_here(now)])
            gained, lost = int((change > WORTHWHILE).sum()), int((change < -WORTHWHILE).sum())
            yield f"| {name} | {kind} | {len(change)} | {gained} | {lost} |"
    ends = [s[-1] for s in sessions]
    hopeless, poor = [e for e in ends if e.hopeless], [e for e in ends if e.reward < LITTLE]
    wrongly, rightly = sum(e.reward >= POOR for e in hopeless), sum(e.hopeless for e in poor)
    yield ""
    yield (
        f"hopeless: said in {len(hopeless)} of {len(sessions)} worlds, in {wrongly} that earned {POOR} and more; of "
        f"{len(poor)} sessions that ended under {LITTLE}, {rightly} said it"
    )
    off = np.array([e.expected - e.reward for e in ends])
    inside = sum(e.low <= e.reward <= e.high for e in ends)
    yield (
        f"expected at the end: {off.mean():+.3f} against earned (standard deviation {off.std():.3f}); the 95 % "
        f"interval held it in {inside} of {len(ends)}"
    )


if __name__ == "__main__":
    main()
