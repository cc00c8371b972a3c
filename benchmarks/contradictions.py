"""Which recordings that contradict their actions are refused, and is any correct one refused?

    python benchmarks/contradictions.py [--trials 24] [--worlds 15] [--tasks pushing scooping] [--seed 41] [--out FILE]

First a table of simulated pushes is spoilt in ways that happen to people: all of it (`SPOILT`), every fourth trial
(`IN_SOME`), and each of its trials alone. Then sound tables of 10 to 19 trials are made in drawn worlds, with plausible
effects that no parameter expresses, and with the noise of a camera (0.8 mm, 30 Hz). Every table is checked as a session
does (`require_sound` and `doubt`), and a trial alone as the answer of an own robot (`trial_doubt`). FILE stores a line
for each correct table, so that a stopped run can continue.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from kept import Kept

from adaptsim_cli.bench.checkpoints import usual_checkpoint
from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.adaptation.checkpoint import load_checkpoint
from sim.errors import RecordingsRefused
from sim.lab.drawn import drawn_world
from sim.rollouts.draws import Disturbances
from sim.rollouts.recorded import RecordedTrials, require_sound
from sim.rollouts.trajectories import contradiction
from sim.solvers.readings import doubt, trial_doubt
from sim.tasks import get_task
from sim.tasks.task import Solver, Task

NOISE_M, RATE_HZ = 0.0008, 30.0
FAILED = (Outcome.SOLVER_FAILED, Outcome.DIVERGED)


@dataclass(frozen=True, eq=False)
class Row:
    """One trial of a table."""

    action: Array
    context: Array
    track: ObjectTrack


def table(task: Task, seed: int, number: int, trials: int) -> list[Row]:
    """Sound trials of random actions in a drawn world, as a camera records them."""
    world, rng, rows = drawn_world(task, seed, number), np.random.default_rng((seed, number)), list[Row]()
    while len(rows) < trials:
        action, context = task.action.sample(rng, 1)[0], task.context.sample(rng, 1)[0]
        drawn = Disturbances.at_random(task, 1, rng)
        track = task.simulate(world.parameters, context, action + drawn.error[0], drawn.nuisance[0], world.unmodelled)
        if track.outcome not in FAILED:
            rows.append(Row(action, context, recorded(track, rng)))
    return rows


def recorded(track: ObjectTrack, rng: np.random.Generator) -> ObjectTrack:
    """A rollout as a camera records it, until shortly after its end."""
    t_s = np.arange(0.0, track.t_s[-1] + 0.3, 1.0 / RATE_HZ)
    state = track.at(t_s) + rng.normal(0.0, NOISE_M, (len(t_s), track.state.shape[1]))
    return replace(track, t_s=t_s, state=state, confidence=np.ones(len(t_s)))


def verdict(solver: Solver, rows: list[Row]) -> str:
    """Why a session refuses the table; "" if it does not."""
    try:
        return doubt(solver, require_sound(as_recorded(solver.task, rows)))
    except (RecordingsRefused, ValueError) as error:
        return str(error)


def as_recorded(task: Task, rows: list[Row]) -> RecordedTrials:
    """The table as a session reads it. Raises RecordingsRefused."""
    names, contexts = tuple(f"{i}" for i in range(len(rows))), np.array([row.context for row in rows])
    tracks = tuple(row.track for row in rows)
    return RecordedTrials(task, names, contexts, np.array([row.action for row in rows]), tracks)


Change = Callable[[Array, Array], tuple[Array, Array]]
"""(times (N,), states (N, 3)) -> the same, spoilt."""


def tracks(change: Change) -> Callable[[list[Row]], list[Row]]:
    """The same spoiling of every trajectory."""

    def spoilt(rows: list[Row]) -> list[Row]:
        changed = [(row, *change(np.array(row.track.t_s), np.array(row.track.state))) for row in rows]
        return [
            replace(row, track=replace(row.track, t_s=t, state=s, confidence=np.ones(len(t)))) for row, t, s in changed
        ]

    return spoilt


def actions(change: Callable[[Array], Array]) -> Callable[[list[Row]], list[Row]]:
    """The same spoiling of every action."""
    return lambda rows: [replace(row, action=change(np.array(row.action))) for row in rows]


def turned(degrees: float) -> Change:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return lambda t, state: (t, state[0] + (state - state[0]) @ R.T)


def early(lead_s: float) -> Change:
    """The clock starts this long before the motion."""
    idle_s = np.arange(0.0, lead_s, 1.0 / RATE_HZ)
    return lambda t, s: (np.r_[idle_s, t + lead_s], np.r_[np.repeat(s[:1], len(idle_s), axis=0), s])


def late(lag_s: float) -> Change:
    """The clock starts this long after the motion began."""
    return lambda t, s: (t[t >= lag_s] - t[t >= lag_s][0], s[t >= lag_s])


def moved(*offset_m: float) -> Change:
    return lambda t, s: (t, s + np.array(offset_m))


def scaled(time: float, *space: float) -> Change:
    return lambda t, s: (t * time, s * np.array(space))


def drifting(speed_m_s: float) -> Change:
    return lambda t, s: (t, s + np.outer(t, [speed_m_s, 0.0, 0.0]))


def spiked(t: Array, s: Array) -> tuple[Array, Array]:
    s[len(t) // 2, 0] += 0.3
    return t, s


def exchanged(order: Callable[[int, int], int]) -> Callable[[list[Row]], list[Row]]:
    return lambda rows: [replace(row, track=rows[order(i, len(rows))].track) for i, row in enumerate(rows)]


SPOILT: dict[str, Callable[[list[Row]], list[Row]]] = {
    "y flipped": tracks(scaled(1.0, 1.0, -1.0, 1.0)),
    "yaw has the other sign": actions(lambda a: a * [-1.0, 1.0]),
    "yaw in degrees": actions(lambda a: a * [57.3, 1.0]),
    "yaw 14 % too small": actions(lambda a: a * [0.86, 1.0]),
    "speed as a share of its range": actions(lambda a: np.array([a[0], 0.4 + 0.4 * (a[1] - 0.4) / 0.8])),
    "mm": tracks(scaled(1.0, 1e3, 1e3, 1e3)),
    "cm": tracks(scaled(1.0, 1e2, 1e2, 1e2)),
    "ms": tracks(scaled(1e3, 1.0, 1.0, 1.0)),
    "Unix times": tracks(lambda t, s: (t + 1.7e9, s)),
    "times doubled": tracks(scaled(2.0, 1.0, 1.0, 1.0)),
    "times halved": tracks(scaled(0.5, 1.0, 1.0, 1.0)),
    **{f"clock {s:g} s early": tracks(early(s)) for s in (0.3, 0.45, 0.6)},
    **{f"clock {s:g} s late": tracks(late(s)) for s in (0.2, 0.4)},
    "frame 60 mm ahead": tracks(moved(0.06, 0.0, 0.0)),
    "frame 90 mm to the left": tracks(moved(0.0, 0.09, 0.0)),
    "frame turned by 10°": tracks(turned(10.0)),
    "frame turned by 90°": tracks(turned(90.0)),
    "relative to the start": tracks(lambda t, s: (t, s - s[:1])),
    "height 0 at the start": tracks(scaled(1.0, 1.0, 1.0, 0.0)),
    "height 1 m too large": tracks(moved(0.0, 0.0, 1.0)),
    "drift of 20 mm/s": tracks(drifting(0.02)),
    "drift of 5 mm/s": tracks(drifting(0.005)),
    "one sample 300 mm off": tracks(spiked),
    "trajectories of the next trial": exchanged(lambda i, n: (i + 1) % n),
    "trajectories in reversed order": exchanged(lambda i, n: n - 1 - i),
    "half are copies under other actions": exchanged(lambda i, n: i % (n // 2)),
    "last 0.4 s cut": tracks(lambda t, s: (t[t < t[-1] - 0.7], s[t < t[-1] - 0.7])),
    "gripper instead of the bottle": tracks(lambda t, s: (t, np.c_[np.minimum(s[:, 0], s[0, 0] + 0.12), s[:, 1:]])),
    "never moves": tracks(lambda t, s: (t, np.repeat(s[:1], len(t), axis=0))),
}


IN_SOME = ("y flipped", "times doubled", "times halved", "clock 0.3 s early", "frame turned by 90°", "never moves")
"""Mistakes that are made in every fourth trial of a table, and in one alone."""


def in_some(spoil: Callable[[list[Row]], list[Row]], rows: list[Row]) -> list[Row]:
    """The table with every fourth trial spoilt."""
    return [new if i % 4 == 1 else row for i, (row, new) in enumerate(zip(rows, spoil(rows), strict=True))]


def alone(solver: Solver, row: Row) -> str:
    """What a session says about one answer of an own robot."""
    try:
        wrong = contradiction(solver.task, row.track, row.context, row.action)
        return wrong or trial_doubt(solver, as_recorded(solver.task, [row]))
    except RecordingsRefused as error:
        return str(error)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=24, help="of the spoilt table")
    parser.add_argument("--worlds", type=int, default=15, help="sound tables of each task")
    parser.add_argument("--tasks", nargs="+", default=["pushing", "scooping"])
    parser.add_argument("--seed", type=int, default=41)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    store = Kept(args.out)
    solvers = {name: load_checkpoint(get_task(name), usual_checkpoint(get_task(name))).solver for name in args.tasks}
    if "pushing" in solvers:
        rows = table(solvers["pushing"].task, args.seed, 0, args.trials)
        reasons = {name: verdict(solvers["pushing"], spoil(rows)) for name, spoil in SPOILT.items()}
        for name, reason in reasons.items():
            sys.stdout.write(f"{name}: {reason or 'READ WITHOUT A WORD'}\n")
        sys.stdout.write(f"{sum(map(bool, reasons.values()))} of {len(reasons)} spoilings are named\n")
        for name in IN_SOME:
            reason = verdict(solvers["pushing"], in_some(SPOILT[name], rows))
            named = sum(bool(alone(solvers["pushing"], row)) for row in SPOILT[name](rows))
            sys.stdout.write(f"{name} in every fourth trial: {reason or 'READ WITHOUT A WORD'}\n")
            sys.stdout.write(f"{name} in one trial alone: named in {named} of {len(rows)}\n")
    alarms = trial_alarms = trials = 0
    for name, solver in solvers.items():
        for number in range(args.worlds):
            row = store.row(name, number, partial(sound, solver, args.seed, number))
            alarms += bool(row["refused"])
            trial_alarms, trials = trial_alarms + row["named_alone"], trials + row["trials"]
            sys.stdout.write(f"{name} {number}: {row['trials']} trials: {row['refused'] or 'read'}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{alarms} of {args.worlds * len(solvers)} sound tables are refused\n")
    sys.stdout.write(f"{trial_alarms} of their {trials} trials would be named alone\n")


def sound(solver: Solver, seed: int, number: int) -> dict[str, Any]:
    trials = int(np.random.default_rng((seed, number, 1)).integers(10, 20))
    rows = table(solver.task, seed, number, trials)
    named = sum(bool(alone(solver, row)) for row in rows)
    return {"trials": trials, "refused": verdict(solver, rows), "named_alone": named}


if __name__ == "__main__":
    main()
