"""Adaptation: from trials to the next simulation parameters."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from sim.adaptation.best import choose_best
from sim.adaptation.judgement import verdict
from sim.adaptation.method import Best, Iteration, Method, Particle, ParticleTrials, Trial
from sim.errors import UnknownName
from sim.tasks.task import Task

if TYPE_CHECKING:
    from sim.checkpoint import Checkpoint

__all__ = [
    "METHODS",
    "Best",
    "Iteration",
    "Method",
    "Particle",
    "ParticleTrials",
    "Trial",
    "choose_best",
    "make_method",
    "verdict",
]

METHODS = {
    "adaptsim": "sim.adaptation.phase2",
    "random": "sim.baselines.random_search",
    "udr": "sim.baselines.udr",
}
"""Name -> the module whose `create(task, checkpoint)` makes it; imported when first asked for."""


def make_method(name: str, task: Task, checkpoint: Checkpoint | None) -> Method:
    """Raises UnknownName, and CheckpointError where the method needs a checkpoint and there is none."""
    if name not in METHODS:
        raise UnknownName(f'there is no method "{name}"; there is: {", ".join(METHODS)}')
    method: Method = import_module(METHODS[name]).create(task, checkpoint)
    return method
