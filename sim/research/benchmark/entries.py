"""The entries of a benchmark beyond the methods that a session can have: baselines, ablations and fixed rules.

An entry is the name of a method, a baseline, an ablation, a fixed rule or a limit. `NAME@omega` and `NAME@margin` are
the same entry with other known ranges of the parameters (`sim.research.benchmark.knowledge`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, reward_table_of
from sim.adaptation.method import Iteration, Method, Particle
from sim.adaptation.methods import make_method, method_names
from sim.adaptation.methods.adaptsim import AdaptSim
from sim.adaptation.simulators import PartStrengths, Simulators
from sim.errors import CheckpointError, UnknownName
from sim.research.benchmark import baselines
from sim.research.benchmark.knowledge import RANGES, Ranges
from sim.research.benchmark.sessions import udr_policies
from sim.rollouts.draws import cover
from sim.tasks.task import SolvedPolicy, Task

if TYPE_CHECKING:
    from sim.adaptation.methods import Factory

UDR, UDR_MEAN, FIRST, SECOND = "udr", "udr-mean", "first-action", "second-action"
ORACLE, BEST_ACTION = "oracle", "best-action"
LIMITS = (ORACLE, BEST_ACTION)
"""Upper bounds, which use knowledge that no method has: the best E, or the best action, in the world."""

REFINEMENTS, POINTS, ELITE = 24, 64, 8
"""The search for the gain with the best mean reward: number of rounds, of candidates in a round, and of candidates that
are kept."""


@dataclass(frozen=True)
class Entry:
    """An entry, from its name. Raises UnknownName for ranges that do not exist."""

    name: str  # without ranges
    ranges: Ranges | None  # None: those of the method itself

    @classmethod
    def parse(cls, text: str) -> Entry:
        """The entry called `text`."""
        name, _, ending = text.partition("@")
        ranges = next((one for one in RANGES if one == ending), None)
        if "@" in text and ranges is None:
            raise UnknownName(f"{text}: after @ there is {' or '.join(RANGES)}")
        return cls(name, ranges)

    @property
    def needs_reward_table(self) -> bool:
        """Whether it looks up the rewards of E before any trial."""
        return self.name.startswith("adaptsim") or self.name in (FIRST, SECOND, "best-of-first", "bo-prior")


def _ablated(strengths: PartStrengths, task: Task, checkpoint: Checkpoint | None) -> Method:
    reward_table = reward_table_of("adaptsim", task, checkpoint)
    assert checkpoint is not None  # it holds the reward table
    return AdaptSim(Simulators(checkpoint.solver, reward_table, strengths))


@dataclass(frozen=True, eq=False)
class PoliciesOfE:
    """A `Method`: the particles of `adaptsim`, with the solver's policies for them instead of free actions."""

    inner: AdaptSim

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The particles of `adaptsim`."""
        return self.inner.start(n, rng)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The particles of `adaptsim`."""
        return self.inner.next(history, rng)


def _without_free_actions(task: Task, checkpoint: Checkpoint | None) -> Method:
    inner = _ablated(PartStrengths(), task, checkpoint)
    assert isinstance(inner, AdaptSim)
    return PoliciesOfE(inner)


BASELINES: Mapping[str, Factory] = {
    "best-of-first": baselines.create_best_of_first,
    "least-squares": baselines.create_least_squares,
    "simopt": baselines.create_simopt,
}
ABLATIONS: Mapping[str, Factory] = {
    "adaptsim-no-weights": partial(_ablated, PartStrengths(weights=0.0)),
    "adaptsim-no-discrepancy": partial(_ablated, PartStrengths(discrepancy=0.0)),
    "adaptsim-no-free-actions": _without_free_actions,
}
"""`adaptsim` without one of its parts; without the margin it is `adaptsim@omega`."""


def _before_any_trial(number: int, checkpoint: Checkpoint, seed: int) -> tuple[SolvedPolicy, ...]:
    task = checkpoint.solver.task
    method = make_method("adaptsim", task, checkpoint)
    assert isinstance(method, AdaptSim)
    particle = method.start(number + 1, np.random.default_rng(seed))[number]
    return (method.policy(particle, ()),)


def _udr(checkpoint: Checkpoint, seed: int) -> tuple[SolvedPolicy, ...]:
    return udr_policies(checkpoint.solver, seed)


@dataclass(frozen=True, eq=False)
class ConstantPolicy:
    """A `SolvedPolicy` of one action in all contexts."""

    action: Array  # (a,) in units
    reward: float  # expected

    def __call__(self, context: Array) -> Array:
        """(c,) -> (a,)"""
        return self.action

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a)"""
        return np.tile(self.action, (len(contexts), 1))

    def predict(self, context: Array) -> tuple[float, float, float]:
        """The expected reward, without an interval."""
        return self.reward, self.reward, self.reward


def _best_mean(checkpoint: Checkpoint, seed: int) -> tuple[SolvedPolicy, ...]:
    solver: Any = checkpoint.solver  # hashed by its identity
    return (_with_best_mean(solver),)


def _require_one_context(task: Task) -> None:
    if task.exact is None or len(task.context):
        raise CheckpointError(
            f"udr-mean is for exact tasks without a context; in {task.name} udr maximises the mean reward itself"
        )


@cache
def _with_best_mean(solver: Any) -> ConstantPolicy:
    """The action with the best mean reward over the parameters, found by a cross-entropy search around UDR's action."""
    task, rng = solver.task, np.random.default_rng(0)
    truths = cover(task.parameters, POINTS, rng)
    best = udr_policies(solver, 0)[0].actions(np.zeros((1, 0)))[0]
    mean, std = task.action.normalise(best), np.full(len(task.action), 0.1)
    top = -1.0
    for _ in range(REFINEMENTS):
        unit = np.concatenate([mean[None], mean + std * rng.standard_normal((POINTS, len(mean)))]).clip(0.0, 1.0)
        actions = task.action.denormalise(unit)
        targets = np.tile(truths, (len(actions), 1))
        repeated = np.repeat(actions, len(truths), axis=0)[:, None]
        earned = (
            solver.expected_rewards(targets, np.zeros((1, 0)), repeated, rng).reshape(len(actions), -1).mean(axis=1)
        )
        order = np.argsort(earned)[::-1][:ELITE]
        if earned[order[0]] > top:
            top, best = float(earned[order[0]]), actions[order[0]]
        mean, std = unit[order].mean(axis=0), unit[order].std(axis=0) + 1e-3
    return ConstantPolicy(best, top)


FixedRule = Callable[[Checkpoint, int], tuple[SolvedPolicy, ...]]
"""(checkpoint, seed) -> policies that never change; the rule's reward is their mean."""

FIXED_RULES: Mapping[str, FixedRule] = {
    UDR: _udr,
    UDR_MEAN: _best_mean,
    FIRST: partial(_before_any_trial, 0),
    SECOND: partial(_before_any_trial, 1),
}
"""Rules that need no trial."""


@cache
def fixed_policies(name: str, checkpoint: Checkpoint, seed: int) -> tuple[SolvedPolicy, ...]:
    """The policies of a fixed rule, which are the same in every world and so are made once in a process."""
    return FIXED_RULES[name](checkpoint, seed)


def entry_names() -> tuple[str, ...]:
    """Everything that a benchmark compares in worlds, without ranges."""
    return tuple(dict.fromkeys((*method_names(), *FIXED_RULES, *BASELINES, *ABLATIONS, *LIMITS)))


def make_entry(name: str, task: Task, checkpoint: Checkpoint | None) -> Method:
    """The method, baseline or ablation. Raises UnknownName, CheckpointError, ExtraMissing."""
    factory = BASELINES.get(name) or ABLATIONS.get(name)
    return make_method(name, task, checkpoint) if factory is None else factory(task, checkpoint)


def require_entry(name: str, checkpoint: Checkpoint) -> None:
    """Raises CheckpointError if the checkpoint lacks something that the entry needs."""
    if name == UDR_MEAN:
        _require_one_context(checkpoint.solver.task)
    elif name in FIXED_RULES:
        reward_table_of(name, checkpoint.solver.task, checkpoint)
    elif name not in LIMITS:
        make_entry(name, checkpoint.solver.task, checkpoint)
