"""How often is it right to stop after two iterations, and to go on after one? Whole sessions of adaptsim in a set's
worlds.

    python benchmarks/stopping.py --task pushing --targets drawn-3            forty worlds that a rule drew
    adaptsim world-tables --task pushing --targets drawn
    python benchmarks/stopping.py --task pushing --targets drawn --tables      looked up: many times faster

A session goes on after its first iteration, which is right where the second one gained more than 0.05. From then on it
says stop, which is wrong where the next iteration gained more than 0.05 after all. Both are base rates, after each
iteration; beside them are those of sessions with a predicted reward below `LOW`. A session that ends under 0.2 should
have said "hopeless", and one that ends above 0.3 should not. Rewards come from true rollouts, or from the half of a
table that no trial sees.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from world_sources import source_in

from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.method import ENOUGH, WORTHWHILE, SessionForecast
from sim.adaptation.methods.adaptsim import AdaptSim, create, forecast_after
from sim.adaptation.outcome_posterior import PosteriorPolicy
from sim.research.benchmark.sessions import Conditions, estimated_reward, run_session
from sim.research.benchmark.worlds import targets_of
from sim.solvers.solver import policy_for
from sim.tasks import get_task

LOW = 0.7
"""A predicted reward below which another iteration might be worth more."""

POOR, LITTLE = 0.3, 0.2
"""What a session earns that was wrongly called hopeless, and one that should have been."""


@dataclass(frozen=True)
class Session:
    """What was said after each iteration, and what was then earned."""

    target: str
    said: tuple[SessionForecast, ...]
    earned: tuple[float, ...]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="pushing")
    parser.add_argument("--targets", default="drawn", help="worlds: a set, or names")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tables", action="store_true", help="look trials and scores up")
    asked = parser.parse_args()
    tell(played(asked.task, asked.targets, asked.seed, tables=asked.tables))


def played(name: str, targets: str, seed: int, *, tables: bool) -> Sequence[Session]:
    """One session in each world, told as it ends."""
    task, found = get_task(name), []
    conditions = Conditions(budget=10 if task.exact else 20)
    checkpoint = load_checkpoint(task)
    method, e = create(task, checkpoint), checkpoint.reward_table
    assert e is not None
    shown = policy_for(checkpoint.solver, e.candidates[:1])
    for target in targets_of(task, targets.split(",")):
        place = source_in(target, checkpoint.solver, tables=tables)
        policies = run_session(checkpoint.solver, AdaptSim(method.simulators), place, conditions, seed)
        own = [policy for policy in policies if isinstance(policy, PosteriorPolicy)]
        earned = tuple(estimated_reward(task, policy.actions, place, conditions, seed).mean for policy in own)
        said = tuple(forecast_after(one.posterior, shown, i) for i, one in enumerate(own, 1))
        found.append(Session(target.name, said, earned))
        last = found[-1].said[-1]
        print(
            f"{target.name:>12}: earned {', '.join(f'{r:.2f}' for r in earned)}; at the end expected "
            f"{last.reward:.2f} ({last.ci95[0]:.2f} to {last.ci95[1]:.2f}), {'hopeless' if last.hopeless else ''}",
            flush=True,
        )
    return found


def tell(sessions: Sequence[Session]) -> None:
    """All that the sessions said, against what came."""
    changes = [
        (number, said.reward, after - now)
        for s in sessions
        for number, (said, now, after) in enumerate(zip(s.said, s.earned, s.earned[1:], strict=False), start=1)
        if not said.hopeless
    ]
    print(
        "| after iteration | predicted | chances | the next gained more than 0.05 | lost more than 0.05 |\n"
        + "|---" * 5
        + "|"
    )
    numbers = sorted({number for number, *_ in changes})
    rows = [(str(n), {n}) for n in numbers] + [(f"{ENOUGH} and later", {n for n in numbers if n >= ENOUGH})]
    for name, included in rows:
        for reward, low, high in (("any", -np.inf, np.inf), (f"below {LOW}", -np.inf, LOW)):
            change = np.array([off for n, predicted, off in changes if n in included and low <= predicted < high])
            gained, lost = int((change > WORTHWHILE).sum()), int((change < -WORTHWHILE).sum())
            print(f"| {name} | {reward} | {len(change)} | {gained} | {lost} |")
    hopeless = [s for s in sessions if s.said[-1].hopeless]
    poor = [s for s in sessions if s.earned[-1] < LITTLE]
    wrongly, rightly = sum(s.earned[-1] >= POOR for s in hopeless), sum(s.said[-1].hopeless for s in poor)
    print(
        f"hopeless: said in {len(hopeless)} of {len(sessions)} worlds, in {wrongly} that earned {POOR} and more; of "
        f"{len(poor)} sessions that ended under {LITTLE}, {rightly} said it"
    )
    off = np.array([s.said[-1].reward - s.earned[-1] for s in sessions])
    inside = [s.said[-1].ci95[0] <= s.earned[-1] <= s.said[-1].ci95[1] for s in sessions]
    print(
        f"expected at the end: {off.mean():+.3f} against earned (standard deviation {off.std():.3f}); the 95 % "
        f"interval held it in {sum(inside)} of {len(inside)}"
    )


if __name__ == "__main__":
    main()
