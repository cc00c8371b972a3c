"""The parts that a lab prints, of all tasks."""

from __future__ import annotations

from sim.lab.holder import holder
from sim.tasks import get_task, task_names
from sim.types import Part


def parts() -> tuple[Part, ...]:
    """Those of every task with an arm, and the board's holder. Raises ExtraMissing without trimesh and manifold3d."""
    tools = [get_task(name).hardware for name in task_names()]
    return (*(part for tool in tools if tool for part in tool.parts()), holder())
