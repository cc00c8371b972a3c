"""Every adaptation method by name: ours, and those of installed packages. Each is imported on first use.

A package offers one by an entry point of the group `adaptsim.methods`: the method's name, and a module with a `create`
(or module:function), which makes a `Method` of a task and a checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from hw.plugins import Registry
from sim.errors import UnknownName
from sim.rollouts.draws import repeats_exactly

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.adaptation.method import Method
    from sim.tasks.task import Task

    Factory = Callable[[Task, Checkpoint | None], Method]
    """Makes a method."""


@dataclass(frozen=True)
class MethodKind:
    """The declaration of a method: its constructor, and the facts that are needed before it is called."""

    create: str = ""  # module:function, called with (task, checkpoint); empty: a package's, or registered here
    needs_whole: bool = False  # every moment of a trial; else partial observations suffice
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
    "direct": MethodKind("sim.adaptation.methods.direct:create", phase_1="nothing"),
    "learn-in-target": MethodKind("sim.research.methods.learn_in_target:create", phase_1="nothing"),
    "random": MethodKind(f"{_SEARCH}:create_random"),
    "sysid-bayes": MethodKind(f"{_SYSID}:create_bayes", needs_whole=True),
    "sysid-bayes-point": MethodKind(f"{_SYSID}:create_point", needs_whole=True),
    "sysid-bayes-state": MethodKind(f"{_SYSID}:create_state", needs_whole=True),
    "udr": MethodKind("sim.adaptation.methods.udr:create"),
}
"""Every method of ours by name; the only list of them."""


def kind_of(name: str) -> MethodKind:
    """The declaration of a method. Methods of other packages and registered methods have the default one."""
    return METHODS.get(name, MethodKind())


REGISTRY: Registry[Factory] = Registry(
    label="method",
    group="adaptsim.methods",
    attribute="create",
    ours={name: kind.create for name, kind in METHODS.items()},
    error=UnknownName,
)

_registered: dict[str, Factory] = {}


def ignores_seed(name: str, task: Task) -> bool:
    """Whether every seed gives the same session, so that one seed is enough."""
    return not kind_of(name).draws and repeats_exactly(task)


def register(name: str, create: Factory) -> None:
    """Offer a method in this process: `create(task, checkpoint)` returns it.

    Registering a name again replaces the earlier one. Raises ValueError for a name of ours or of an installed package.
    """
    if name in REGISTRY:
        raise ValueError(f"the method {name!r} exists already: choose another name")
    _registered[name] = create


def method_names() -> tuple[str, ...]:
    """Names of our methods, of those of installed packages, and of those registered in this process."""
    return tuple(dict.fromkeys((*REGISTRY.names(), *_registered)))


def factory_of(name: str) -> Factory:
    """The function that makes the method. Raises UnknownName, also for a package that cannot be loaded."""
    return _registered[name] if name in _registered else REGISTRY.get(name)


def make_method(name: str, task: Task, checkpoint: Checkpoint | None) -> Method:
    """Raises UnknownName, and CheckpointError if the method needs a checkpoint and there is none."""
    return factory_of(name)(task, checkpoint)
