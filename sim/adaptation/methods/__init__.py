"""Every adaptation method by name: ours, and those of installed packages. Each is imported on first use.

A package offers one by an entry point of the group `adaptsim.methods`: the method's name, and a module with a `create`
(or module:function), which makes a `Method` of a task and a checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Literal

from hw.plugins import PluginError, clashes, offers
from sim.errors import UnknownName, did_you_mean
from sim.rollouts.draws import repeats_exactly

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.adaptation.method import Method
    from sim.tasks.task import Task

OFFERED = "adaptsim.methods"
"""The group of entry points by which packages offer methods."""


@dataclass(frozen=True)
class MethodKind:
    """A method as it is declared: who makes it, and what must be known of it before it is made."""

    create: str = ""  # module:function, called with (task, checkpoint); empty: a package's, or registered here
    needs_whole: bool = False  # every moment of a trial; else it learns from what was observed
    draws: bool = True  # random numbers; else the same trials give the same particles and policies
    takes_posterior: bool = False  # can begin with the posterior of another session
    phase_1: Literal["dataset", "episodes", "nothing"] = "dataset"  # the simulations that it needs


_Q_POLICY, _SEARCH = "sim.research.methods.q_policy", "sim.research.methods.search"
_SYSID = "sim.research.methods.sysid"

METHODS: Mapping[str, MethodKind] = {
    "adaptsim": MethodKind("sim.adaptation.methods.adaptsim:create", draws=False, takes_posterior=True),
    "adaptsim-belief": MethodKind("sim.adaptation.methods.belief:create", draws=False, takes_posterior=True),
    "adaptsim-iteration": MethodKind(f"{_Q_POLICY}:create_iteration", needs_whole=True, phase_1="episodes"),
    "adaptsim-state": MethodKind(f"{_Q_POLICY}:create_state", needs_whole=True, phase_1="episodes"),
    "adaptsim-history": MethodKind(f"{_Q_POLICY}:create_history", needs_whole=True, phase_1="episodes"),
    "bo": MethodKind(f"{_SEARCH}:create_bo"),
    "bo-prior": MethodKind(f"{_SEARCH}:create_prior"),
    "learn-in-target": MethodKind("sim.research.methods.learn_in_target:create", phase_1="nothing"),
    "random": MethodKind(f"{_SEARCH}:create_random"),
    "sysid-bayes": MethodKind(f"{_SYSID}:create_bayes", needs_whole=True),
    "sysid-bayes-point": MethodKind(f"{_SYSID}:create_point", needs_whole=True),
    "sysid-bayes-state": MethodKind(f"{_SYSID}:create_state", needs_whole=True),
    "udr": MethodKind("sim.adaptation.methods.udr:create"),
}
"""Every method of ours by name; the only list of them."""


def kind_of(name: str) -> MethodKind:
    """The declaration of a method; of a package's, or one registered here, the usual one."""
    return METHODS.get(name, MethodKind())


_registered: dict[str, Callable[[Task, Checkpoint | None], Method]] = {}


def ignores_seed(name: str, task: Task) -> bool:
    """Whether every seed gives the same session: one is enough then."""
    return not kind_of(name).draws and repeats_exactly(task)


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
        module, _, function = METHODS[name].create.partition(":")
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
