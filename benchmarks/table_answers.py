"""How far a world's table answers as the world does: looked-up trials against true rollouts, and these against others.

    python benchmarks/table_answers.py --task scooping --actions 12

Actions fill their ranges in one half; in the other they are those of policies for E in Omega. Each is executed with
errors of its own, as in a session, so that two true rollouts differ as well.
"""

from __future__ import annotations

import argparse

import numpy as np
from studies.shared import table_of

from hw.types import Array
from sim.research.benchmark.places import Simulated
from sim.research.benchmark.targets import targets_of
from sim.rollouts.draws import cover
from sim.tasks import get_task


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--targets", default="named", help="worlds with a table")
    parser.add_argument("--actions", type=int, default=12, help="of each world; an even number")
    asked = parser.parse_args()
    task = get_task(asked.task)
    rewards = np.stack(
        [
            answers(asked.task, target.name, asked.actions, i)
            for i, target in enumerate(targets_of(task, [asked.targets]))
        ]
    )  # (worlds, 3, actions)
    half = asked.actions // 2
    for kind, which in (("actions that fill their ranges", np.s_[..., :half]), ("of policies", np.s_[..., half:])):
        looked_up, true, again = np.moveaxis(rewards[which], 1, 0)
        print(f"{asked.task}, {kind} ({true.size}):")
        for name, other in (("looked up against true", looked_up), ("true against true", again)):
            agrees, off = np.mean((other > 0) == (true > 0)), np.abs(other - true).mean()
            print(f"  {name}: success agrees in {agrees:.3f}, reward {off:.3f} apart; mean {other.mean():.3f}")


def answers(task_name: str, world: str, n: int, seed: int) -> Array:
    """(3, n) rewards of the same commands: looked up, by a true rollout, and by another one."""
    checkpoint, table = table_of(task_name, world)
    task, solver = checkpoint.solver.task, checkpoint.solver
    (target,) = targets_of(task, [world])
    there, rng = Simulated(solver, target.world), np.random.default_rng(seed)
    contexts = task.context.sample(rng, n)
    policies = solver.policies(cover(task.parameters, 4, rng)[:, None, :], rng)
    chosen = [policies[k % 4].actions(contexts[k : k + 1])[0] for k in range(n // 2, n)]
    actions = np.concatenate([cover(task.action, n // 2, rng), np.stack(chosen)])
    places = (table, there, there)
    return np.stack([p.play(contexts, actions, np.random.default_rng(1 + i)).rewards for i, p in enumerate(places)])


if __name__ == "__main__":
    main()
