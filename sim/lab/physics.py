"""The physics of a world: that of its task, or a foreign one that training does not use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from importlib import import_module
from typing import Any, Literal

from hw.extras import missing
from hw.types import Array
from sim.errors import ExtraMissing, OutOfRange
from sim.tasks import get_task
from sim.tasks.task import Simulate, Task

Physics = Literal["drake", "mujoco"]
"""Name in a world file. "drake" is the physics of the task itself, even if that does not use Drake."""

_MUJOCO = {"pushing": "sim.research.mujoco.pushing", "scooping": "sim.research.mujoco.scooping"}
"""Task -> the module with its `simulate`; imported on first use."""

_DRAKE_ONLY = ("contact",)
"""Effects that choose among Drake's options."""


def require_possible(task: Task, physics: Physics, unmodelled: Any) -> None:
    """Raises OutOfRange if the task does not have this physics, or the physics does not have an effect."""
    if physics == "drake":
        return
    if task.name not in _MUJOCO:
        raise OutOfRange(f'physics = "{physics}" exists for {" and ".join(_MUJOCO)}, not for {task.name}; leave it out')
    nominal = task.unmodelled()
    for effect in _DRAKE_ONLY:
        if getattr(unmodelled, effect, None) != getattr(nominal, effect, None):
            raise OutOfRange(
                f'[unmodelled] {effect} = "{getattr(unmodelled, effect)}" chooses among Drake\'s contact laws, '
                f'but physics = "{physics}" has its own; leave one of the two out'
            )


def effects_in(physics: Physics, unmodelled: Any) -> dict[str, Any]:
    """The unmodelled effects that a physics supports, by name, with their values."""
    effects = asdict(unmodelled)
    return effects if physics == "drake" else {k: v for k, v in effects.items() if k not in _DRAKE_ONLY}


def in_physics(task: Task, physics: Physics) -> Task:
    """The task with the rollouts of a physics. Raises ExtraMissing."""
    return task if physics == "drake" else replace(task, simulate=simulate_of(task.name, physics), simulate_many=None)


def physics_name(task: Task, physics: Physics) -> str:
    """The simulator that a world runs in: the task's own, or a foreign one."""
    return task.physics if physics == "drake" else physics


def simulate_of(task_name: str, physics: Physics) -> Simulate:
    """`Task.simulate`, or the same in a foreign physics. Raises ExtraMissing if that is not installed."""
    if physics == "drake":
        return get_task(task_name).simulate
    simulate: Simulate = _module(task_name, f'a world with physics = "{physics}"').simulate
    return simulate


def mjcf_of(task_name: str) -> Callable[[Any, Array, Array], str]:
    """Writes the MuJoCo scene of a trial: (course, parameters, nuisance) -> MJCF. Raises OutOfRange, ExtraMissing."""
    if task_name not in _MUJOCO:
        raise OutOfRange(f"a scene in MuJoCo exists for {' and '.join(_MUJOCO)}, not for {task_name}")
    write: Callable[[Any, Array, Array], str] = _module(task_name, "a scene in MuJoCo").mjcf
    return write


def _module(task_name: str, what: str) -> Any:
    try:
        return import_module(_MUJOCO[task_name])
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != "mujoco":
            raise
        raise ExtraMissing(missing(what, "mujoco", "mujoco")) from error
