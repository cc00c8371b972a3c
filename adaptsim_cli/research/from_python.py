"""Rollouts of an own policy, and benchmarks, as rows for a data frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np

from adaptsim_cli.errors import UsageError
from adaptsim_cli.session.exporting import Row
from hw.types import Array
from sim.errors import OutOfRange
from sim.lab.world import World, load_world
from sim.research.benchmark.trial_sources import SimulatedTrials, TrialSource
from sim.tasks.task import Solver, Task
from sim.types import Space

Policy = Callable[[Array], "Array | Sequence[float] | Mapping[str, float]"] | Sequence[float] | Mapping[str, float]
"""A function of the context (c,) that returns an action in units, or one action for all contexts. An action is given as
numbers or by name."""

Through = Literal["direct", "lab"]
"""Without arm or camera, or the whole simulated lab: arm, camera and tracking."""


def rollout(task_name: str, policy: Policy, *, world: str, n: int, seed: int, through: Through) -> list[Row]:
    """See `adaptsim_cli.api.rollout`."""
    from adaptsim_cli.bench.checkpoints import resolve, task_of, usual_checkpoint
    from sim.adaptation.checkpoint import load_checkpoint

    if n < 1:
        raise UsageError(f"n = {n}: at least one rollout")
    task = task_of(resolve({"task": task_name}).config)
    target, rng = load_world(world, task), np.random.default_rng(seed)
    with _trial_source(load_checkpoint(task, usual_checkpoint(task)).solver, target, seed, through) as place:
        contexts = task.context.sample(rng, n)
        act = policy if callable(policy) else lambda _: policy
        actions = np.stack([action_of(task.action, act(context)) for context in contexts])
        trials = place.play(contexts, actions, rng)
    return [
        {
            "trial": number,
            **_columns("context", task.context, trial.context),
            **_columns("action", task.action, trial.action),
            "succeeded": trial.end_state is not None,
            "reward": float(trial.reward),
        }
        for number, trial in enumerate(trials, start=1)
    ]


def action_of(space: Space, values: Any) -> Array:
    """(a,) in units from numbers in order, or from values by name. Raises UsageError, OutOfRange."""
    if isinstance(values, Mapping):
        if set(values) != set(space.names):
            raise UsageError(
                f"an action by name has {', '.join(space.names)}; this one has {', '.join(map(str, values))}"
            )
        values = [values[name] for name in space.names]
    action = np.asarray(values, dtype=np.float64)
    if action.shape != (len(space),):
        raise UsageError(f"an action has {len(space)} numbers ({', '.join(space.names)}), not the shape {action.shape}")
    for d, value in zip(space.dimensions, action, strict=True):
        if not d.low <= value <= d.high:  # NaN, too
            raise OutOfRange(f"{d.label} = {value:g} lies outside of [{d.low:g}, {d.high:g}]")
    return action


def benchmark(
    task: str, *, worlds: str, methods: str, budget: int, seeds: int | None, fresh: int, out: Path | None
) -> list[Row]:
    """See `adaptsim_cli.api.benchmark`."""
    from adaptsim_cli.bench.checkpoints import resolve
    from adaptsim_cli.research import benchmarking
    from sim.rollouts.executors import serial_executor

    request = benchmarking.request_of(resolve({"task": task}), worlds, methods, budget, fresh, seeds, "", out)
    with serial_executor() as here:
        comparison = benchmarking.benchmark(request, here, lambda *_: None)
    return [
        {
            "world": row.target, "method": row.method, "seed": row.seed, "trials": trials, "reward": reward,
            "is_final": (trials, reward) == row.curve[-1],
        }
        for row in comparison.rows
        for trials, reward in row.curve
    ]  # fmt: skip


@contextmanager
def _trial_source(solver: Solver, world: World, seed: int, through: Through) -> Iterator[TrialSource]:
    direct = SimulatedTrials(solver, world)
    if through == "direct":
        yield direct
        return
    if through != "lab":
        raise UsageError(f"through = {through!r}: it must be 'direct' or 'lab'")
    from adaptsim_cli.research.lab_place import InLab, rig_in_lab

    task: Task = solver.task
    task.require_hardware()
    world.require_lab()
    with rig_in_lab(task, world, seed) as (_, rig):
        yield InLab(rig, direct, rig.executable)


def _columns(of: str, space: Space, values: Array) -> Row:
    return {f"{of}_{name}": float(value) for name, value in zip(space.names, values, strict=True)}
