"""Every adaptation method by name; the only list of them. Each is imported on first use."""

from __future__ import annotations

from importlib import import_module

from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Method
from sim.errors import UnknownName, did_you_mean
from sim.tasks.task import Task

METHODS = {
    "adaptsim": "sim.adaptation.methods.adaptsim:create",
    "adaptsim-belief": "sim.adaptation.methods.belief:create",
    "adaptsim-iteration": "sim.research.methods.q_policy:create_iteration",
    "adaptsim-state": "sim.research.methods.q_policy:create_state",
    "adaptsim-history": "sim.research.methods.q_policy:create_history",
    "bo": "sim.research.methods.search:create_bo",
    "bo-prior": "sim.research.methods.search:create_prior",
    "learn-in-target": "sim.research.methods.learn_in_target:create",
    "random": "sim.research.methods.search:create_random",
    "sysid-bayes": "sim.research.methods.sysid:create_bayes",
    "sysid-bayes-point": "sim.research.methods.sysid:create_point",
    "sysid-bayes-state": "sim.research.methods.sysid:create_state",
    "udr": "sim.adaptation.methods.udr:create",
}
"""Name -> the function (task, checkpoint) that makes it; imported on first use."""


def make_method(name: str, task: Task, checkpoint: Checkpoint | None) -> Method:
    """Raises UnknownName, and CheckpointError if the method needs a checkpoint and there is none."""
    if name not in METHODS:
        raise UnknownName(
            f'method "{name}" is not known: it must be one of {", ".join(METHODS)}{did_you_mean(name, METHODS)}'
        )
    module, _, function = METHODS[name].partition(":")
    method: Method = getattr(import_module(module), function)(task, checkpoint)
    return method
