"""The reference of parameters and actions, from the tasks."""

from __future__ import annotations

import inspect

from sim.tasks import TASKS, get_task
from sim.tasks.task import Task
from sim.types import Dimension

PARAMETERS_HEAD = """# Parameters and actions

Written by `make docs` from the tasks. What each word means: [glossary](../start/glossary.md). A session, a world file and
`--param`, `--action`, `--context` use the short names in the first column.

* **Simulation parameters** span Ω. The *margin* is how far the simulator has been tried beyond it.
* A **context** is what a task policy sees before a trial, an **action** what it chooses.
* A **nuisance** differs from trial to trial; nobody chooses it, and the policy does not know it.
"""


def parameters() -> str:
    """One section per task, one table per space."""
    parts = [PARAMETERS_HEAD]
    for name in TASKS:
        task = get_task(name)
        parts.append(f"## {name}\n\n{task.title[0].upper()}{task.title[1:]}. {_reward(task)}\n")
        margin = dict(zip(task.margin.names, task.margin.dimensions, strict=True))
        for title, space in (
            ("Simulation parameters", task.parameters),
            ("Context", task.context),
            ("Action", task.action),
            ("Nuisance", task.nuisance),
        ):
            if not len(space):
                continue
            wide = space is task.parameters
            parts += [
                f"### {title} of {name}\n",
                f"| name | plain name | range |{' margin |' if wide else ''} meaning |",
            ]
            parts.append("|---|---|---|---|" + ("---|" if wide else ""))
            for dimension in space.dimensions:
                if not (dimension.plain and dimension.meaning):
                    raise SystemExit(f"{name}: {dimension.name} has no plain name or no meaning: give it both")
                more = f" {_range(margin[dimension.name])} |" if wide else ""
                parts.append(
                    f"| `{dimension.name}` | {dimension.plain} | {_range(dimension)} |{more} {dimension.meaning} |"
                )
            parts.append("")
    return "\n".join(parts)


def _reward(task: Task) -> str:
    """The reward by the formula in its docstring."""
    formula = (inspect.getdoc(task.reward_of_success) or "").partition(", for (")[0]
    return f"A success earns `{formula}`, and a failure 0 ([the reward](../start/concepts.md#the-reward))."


def _range(dimension: Dimension) -> str:
    scale = {"linear": "", "log": ", logarithmic", "integer": ", whole"}[dimension.scale]
    unit = f" {dimension.unit}" if dimension.unit else ""
    return f"{dimension.low:.4g} to {dimension.high:.4g}{unit}{scale}"
