"""Every adaptation method by name: ours, and those of installed packages. Each is imported on first use.

A package offers one by an entry point of the group `adaptsim.methods`: the method's name, and a module with a `create`
(or module:function), which makes a `Method` of a task and a checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING

from hw.plugins import PluginError, clashes, offers
from sim.errors import UnknownName, did_you_mean
from sim.rollouts.draws import repeats_exactly

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.adaptation.method import Method
    from sim.tasks.task import Task

OFFERED = "adaptsim.methods"
"""The group of entry points by which packages offer methods."""

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


WHOLE = frozenset(name for name in METHODS if name.startswith(("sysid-", "adaptsim-")) and name != "adaptsim-belief")
"""The methods that need every moment of a trial; the others learn from what was observed of it."""


DRAW_NOTHING = ("adaptsim", "adaptsim-belief")
"""Methods without a random number: the same trials give the same particles and policies."""

_registered: dict[str, Callable[[Task, Checkpoint | None], Method]] = {}


def ignores_seed(name: str, task: Task) -> bool:
    """Whether every seed gives the same session: one is enough then."""
    return name in DRAW_NOTHING and repeats_exactly(task)


def register(name: str, create: Callable[[Task, Checkpoint | None], Method]) -> None:
    """Offer a method in this process: `create(task, checkpoint)` returns it.

    Registering a name again replaces the earlier one. Raises ValueError for a name of ours or of an installed package.
    """
    if name in METHODS or any(offer.name == name for offer in offers(OFFERED)):
        raise ValueError(f"the method {name!r} exists already: choose another name")
    _registered[name] = create


def method_names() -> tuple[str, ...]:
    """Names of our methods, of those of installed packages, and of those registered in this process."""
    return tuple(dict.fromkeys((*METHODS, *(offer.name for offer in offers(OFFERED)), *_registered)))


def factory_of(name: str) -> Callable[[Task, Checkpoint | None], Method]:
    """The function that makes the method. Raises UnknownName, also for a package that cannot be loaded."""
    if name in METHODS:
        module, _, function = METHODS[name].partition(":")
        ours: Callable[[Task, Checkpoint | None], Method] = getattr(import_module(module), function)
        return ours
    if name in _registered:
        return _registered[name]
    offer = next((one for one in offers(OFFERED) if one.name == name), None)
    if offer is None:
        names = method_names()
        raise UnknownName(
            f'method "{name}" is not known: it must be one of {", ".join(names)}{did_you_mean(name, names)}'
        )
    try:
        theirs: Callable[[Task, Checkpoint | None], Method] = offer.load("create")
    except PluginError as error:
        raise UnknownName(f"method {error}") from error
    return theirs


def make_method(name: str, task: Task, checkpoint: Checkpoint | None) -> Method:
    """Raises UnknownName, and CheckpointError if the method needs a checkpoint and there is none."""
    return factory_of(name)(task, checkpoint)


def clashing() -> tuple[str, ...]:
    """A sentence for each method of a package that cannot be used because of its name."""
    return clashes(OFFERED, set(METHODS))
