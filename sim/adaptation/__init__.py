"""Adaptation: from trials to the next simulation parameters."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from sim.adaptation.best import choose_best
from sim.adaptation.judgement import verdict
from sim.adaptation.method import Best, Iteration, Method, Particle, ParticleTrials, Trial
from sim.errors import CheckpointError, UnknownName
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
    "adaptsim": "sim.adaptation:make_default",
    "adaptsim-belief": "sim.adaptation.belief:create",
    "adaptsim-iteration": "sim.adaptation.phase2:create_iteration",
    "adaptsim-state": "sim.adaptation.phase2:create_state",
    "adaptsim-history": "sim.adaptation.phase2:create_history",
    "random": "sim.baselines.random_search:create",
    "udr": "sim.baselines.udr:create",
}
"""Name -> the function of a task and a checkpoint that makes it; imported when first asked for."""


def make_method(name: str, task: Task, checkpoint: Checkpoint | None) -> Method:
    """Raises UnknownName, and CheckpointError where the method needs a checkpoint and there is none."""
    if name not in METHODS:
        raise UnknownName(f'there is no method "{name}"; there is: {", ".join(METHODS)}')
    module, _, function = METHODS[name].partition(":")
    method: Method = getattr(import_module(module), function)(task, checkpoint)
    return method


def make_default(task: Task, checkpoint: Checkpoint | None) -> Method:
    """The AdaptSim that earned most on the held-out targets of the checkpoint. Raises CheckpointError."""
    if checkpoint is None:
        raise CheckpointError(f"adaptsim needs a checkpoint: make one with `adaptsim pretrain --task {task.name}`")
    return make_method(checkpoint.method, task, checkpoint)
