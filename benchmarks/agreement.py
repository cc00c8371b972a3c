"""Does a rollout without an arm have the same outcome as the whole lab? One trial in each of many drawn worlds, both
ways.

    python benchmarks/agreement.py --task scooping --worlds 60

The lab's trial has everything: placing, finding, planning, the whole arm, the way home, filming and tracking. The
rollout is what training simulates, in the same world, at the place where the object really was. Actions are those of
the shipped policy of an E drawn in Omega for each world. Disagreements are written out one by one; the last line is one
JSON object.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from typing import Any, cast

import numpy as np

from adaptsim_cli.research.lab_place import Nobody, rig_in_lab
from adaptsim_cli.session.operator import Operator
from hw.errors import MotionRefused
from hw.types import Array
from perception.errors import PerceptionError
from perception.piece.tracking import LOST_ON_THE_WAY
from perception.types import ObjectTrack, Outcome
from sim.adaptation.checkpoint import load_checkpoint
from sim.adaptation.stages import TrialKey
from sim.errors import NotExecutable
from sim.lab.drawn import drawn_world, effects_of
from sim.lab.world import World
from sim.solvers.solver import policy_for
from sim.tasks import get_task
from sim.tasks.pushing import rollout as pushing
from sim.tasks.scooping import rollout as scooping
from sim.tasks.task import Task
from sim.types import ToolMotion

INNER = 0.8
"""Share of the contexts' ranges: a person who misses the mark still puts the object inside of them."""

NUDGE_M = 0.0003
"""How far the object is moved to see whether a rollout agrees with itself: less than a camera errs."""


@dataclass(frozen=True)
class Row:
    """One world."""

    number: int
    parameters: dict[str, float]
    effects: dict[str, Any]
    action: dict[str, float]
    refused: str = ""  # why there was no trial in the lab
    outcome: tuple[str, str] = ("", "")  # rollout, lab
    reward: tuple[float, float] = (0.0, 0.0)
    end_m: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
    true_m: tuple[tuple[float, ...], ...] = ()  # where the object truly was in the lab after each motion with contact
    apart_mm: float = 0.0  # between the two ends on the table
    is_lost: bool = False  # on the way home
    repeated: tuple[str, ...] = ()  # outcomes of the rollout at distances that differ by `NUDGE_M`
    flags: tuple[str, ...] = field(default_factory=tuple)
    wall_s: float = 0.0

    @property
    def agrees(self) -> bool:
        return self.outcome[0] == self.outcome[1]


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    one = partial(trial, arguments.task, arguments.seed)
    rows = list[Row]()
    with ProcessPoolExecutor(arguments.workers, mp_context=get_context("spawn")) as pool:
        for row in pool.map(one, range(arguments.worlds)):
            rows.append(row)
            print(row_in_words(row), flush=True)
    print(json.dumps(summary(task, rows)))


def trial(name: str, seed: int, number: int) -> Row:
    """World `number` of `seed`, in the lab and without an arm."""
    task, world, began = get_task(name), drawn_world(get_task(name), seed, number), time.monotonic()
    rng = np.random.default_rng((seed, number, 1))
    wanted = task.context.denormalise(INNER * rng.random(len(task.context)) + (1.0 - INNER) / 2.0)
    policy = policy_for(load_checkpoint(task, "default").solver, task.parameters.sample(rng, 1))
    facts: dict[str, Any] = {
        "number": number,
        "parameters": dict(zip(task.parameters.names, world.parameters.round(6).tolist(), strict=True)),
        "effects": effects_of(task, world),
    }
    with rig_in_lab(task, world, seed) as (lab, rig):
        try:
            placed = rig.place(wanted, TrialKey(1, 0), cast(Operator, Nobody()))
            action = policy(placed.context)
            facts["action"] = dict(zip(task.action.names, action.round(6).tolist(), strict=True))
            executed = rig.execute(rig.plan(placed, action))
            executed.files()
            seen = executed.track().track
        except (NotExecutable, MotionRefused, PerceptionError) as error:
            return Row(**{"action": {}, **facts}, refused=str(error), wall_s=time.monotonic() - began)
        truth = lab.truth()["trials"][-1]
        X_BO = np.array(truth["X_BO_placed"])
    motion = task.require_hardware().plan(placed.context, action)
    alone = without_arm(task, world, motion, X_BO)
    back_m = np.zeros((4, 4))
    back_m[0, 3] = NUDGE_M
    repeated = [without_arm(task, world, motion, X_BO + sign * back_m).outcome.value for sign in (-1.0, 1.0)]
    return Row(
        **facts,
        outcome=(alone.outcome.value, seen.outcome.value),
        reward=(task.score(alone, placed.context), task.score(seen, placed.context)),
        end_m=(tuple(alone.state[-1].round(4).tolist()), tuple(seen.state[-1].round(4).tolist())),
        true_m=tuple(tuple(np.round(np.array(m["X_BO"])[-1, :3, 3], 4).tolist()) for m in truth["motions"]),
        is_lost=any(LOST_ON_THE_WAY in flag for flag in seen.flags),
        apart_mm=1e3 * float(np.linalg.norm(alone.state[-1, :2] - seen.state[-1, :2])),
        repeated=tuple(repeated),
        flags=(*alone.flags, *seen.flags),
        wall_s=time.monotonic() - began,
    )


def without_arm(task: Task, world: World, motion: ToolMotion, X_BO: Array) -> ObjectTrack:
    """The rollout of training with the object at X_BO (4, 4)."""
    facts = (motion, X_BO, world.parameters, world.nuisance, world.unmodelled)
    if task.name == "pushing":
        return pushing.track_of(pushing.readings(*facts))
    return scooping.track_of(scooping.readings(*facts), motion)


def summary(task: Task, rows: Sequence[Row]) -> dict[str, Any]:
    """The figures over all worlds in which there was a trial."""
    done = [row for row in rows if not row.refused]
    near = [row.apart_mm for row in done if row.agrees and task_succeeded(row)]
    return {
        "task": task.name,
        "worlds": len(rows),
        "refused": len(rows) - len(done),
        "agree": float(np.mean([row.agrees for row in done])),
        "success": [float(np.mean([task_succeeded(row, i) for row in done])) for i in (0, 1)],
        "apart_mm_median": float(np.median(near)) if near else None,
        "lost_on_the_way": sum(row.is_lost for row in done),
        "itself": float(np.mean([[o == row.outcome[0] for o in row.repeated] for row in done])),
    }


def task_succeeded(row: Row, which: int = 0) -> bool:
    """Whether a trial succeeded."""
    return row.outcome[which] in (Outcome.ON_BLADE.value, Outcome.UPRIGHT.value)


def row_in_words(row: Row) -> str:
    if row.refused:
        return f"{row.number}: no trial: {row.refused}"
    verdict = (
        ""
        if row.agrees
        else f"  DISAGREE {row.end_m}, truly {row.true_m} {row.parameters} {row.effects} {row.action} {row.flags}"
    )
    rewards = ", ".join(f"{reward:.2f}" for reward in row.reward)
    return f"{row.number}: {' / '.join(row.outcome)}, {rewards}, {row.apart_mm:.1f} mm, {row.wall_s:.0f} s{verdict}"


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="scooping")
    parser.add_argument("--worlds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0, help="of the worlds, the labs and the actions")
    parser.add_argument("--workers", type=int, default=2)
    return parser.parse_args()


if __name__ == "__main__":
    main()
