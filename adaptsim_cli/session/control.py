"""Control trials: the pairs of a session, their result and their cost.

A control trial is made in the same drawn context as a trial of the session, by another policy. Nobody sees which is
which until their iteration is complete, and the session learns nothing from them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen.outputs.trials import ControlRecord
from adaptsim_cli.session.folders import names
from adaptsim_cli.session.history import played_of
from adaptsim_cli.session.records import Draw, SessionFacts, TrialRecord, generator
from adaptsim_cli.session.store import SessionStore
from hw.types import Array
from sim.adaptation.paired import PAIRS, compare, power
from sim.adaptation.planned_bets import HIGH
from sim.adaptation.stages import Role, RunTrial
from sim.tasks.task import SolvedPolicy


@dataclass(frozen=True, eq=False)
class ControlPolicy:
    """A task policy that makes control trials."""

    policy: SolvedPolicy
    mean: Array  # (p,) parameters that it was trained for, or their mean


ITERATIONS, GAINS = 5, (0.2, 0.4)
"""The assumed number of iterations if a session states no number of pairs, and the gains for which it says whether they
can be shown."""

ControlPolicies = Callable[[], tuple[ControlPolicy, ...]]
"""Trains the policies of a control. Each trial is made by one of them, drawn at random, so the control is their mean.
"""


def policy_of_trial(policies: Sequence[ControlPolicy], facts: SessionFacts, stage: RunTrial) -> ControlPolicy:
    """The policy of one control trial; the same for each of its attempts."""
    rng = generator(facts.control_seed, Draw.CONTROL, stage.iteration, stage.particle, stage.trial)
    return policies[int(rng.integers(len(policies)))]


def is_hidden(store: SessionStore, iteration: int) -> bool:
    """Whether an iteration must not show yet which policy made which trial."""
    return store.facts.layout.has_control(iteration) and store.result(iteration) is None


def pairs_of(facts: SessionFacts, played: Sequence[TrialRecord]) -> tuple[tuple[TrialRecord, TrialRecord], ...]:
    """(trial of the session, its control trial) of each complete pair, in the order in which pairs were completed."""
    by_number = {trial.trial: trial for trial in played}
    partners = dict[tuple[int, int, int], dict[Role, TrialRecord]]()
    for iteration in range(max((trial.iteration for trial in played), default=0)):
        numbers = facts.layout.numbers(iteration)
        for slot, number in zip(facts.layout.slots(iteration), numbers, strict=True):
            if number in by_number and slot.role is not Role.ALONE:
                partners.setdefault((iteration, slot.particle, slot.trial), {})[slot.role] = by_number[number]
    complete = [(both[Role.OWN], both[Role.CONTROL]) for both in partners.values() if len(both) == 2]
    return tuple(sorted(complete, key=lambda pair: max(pair[0].trial, pair[1].trial)))


def compared(facts: SessionFacts, played: Sequence[TrialRecord]) -> ControlRecord | None:
    """The result of the pairs; None without a pair."""
    pairs = pairs_of(facts, played)
    if not pairs:
        return None
    own, control = (np.array([pair[which].reward for pair in pairs]) for which in (0, 1))
    shown = compare(own, control, planned_pairs(facts))
    return ControlRecord(
        control=facts.control,
        pairs=shown.pairs,
        mean_reward=shown.mean,
        control_reward=shown.control_mean,
        difference=shown.difference,
        ci95=(shown.low, shown.high),
        claim=shown.claim,
        decided_after=shown.decided_after,
        further=shown.further,
    )


def planned_pairs(facts: SessionFacts) -> int:
    """The number of pairs for which the comparison is planned."""
    layout = facts.layout
    in_five = sum(slot.role is Role.CONTROL for i in range(ITERATIONS) for slot in layout.slots(i))
    return facts.pairs or in_five


def power_in_words(facts: SessionFacts) -> str:
    """Which gains the planned pairs can show, in one sentence."""
    pairs = planned_pairs(facts)
    first, *others = (f"{gain:.1f} in {100 * power(gain, pairs):.0f} %" for gain in GAINS)
    sentence = (
        f"The {pairs} planned pairs show a gain of {first} of such sessions, "
        f"and {', '.join(f'of {other}' for other in others)}, where the success rate rises to {HIGH:.2f}; lower rates "
        "need more pairs."
    )
    if facts.pairs:
        return sentence
    return f"{sentence} With --pairs {PAIRS} they show {GAINS[0]:.1f} in {100 * power(GAINS[0], PAIRS):.0f} %."


def cost_in_words(store: SessionStore, first: int, iterations: int) -> str:
    """The cost of the control in these iterations, from number `first` (counted from 0) on, in one sentence."""
    layout = store.facts.layout
    coming = range(first, first + iterations)
    so_far = sum(trial.role is Role.CONTROL for trial in played_of(store) if trial.iteration - 1 in coming)
    more = sum(slot.role is Role.CONTROL for i in coming for slot in layout.slots(i)) - so_far
    each = layout.particles * layout.trials
    if not more:
        return (
            f"Control trials of {store.facts.control} begin with iteration 2, with the first policies that learnt from "
            f"trials: {each} more in each iteration."
        )
    trial_s = seconds_of_trial(store)
    took = f", about {max(1.0, more * trial_s / 60.0):.0f} min" if trial_s else ""
    return (
        f"Control by {store.facts.control}: {more} more trials{took}. Which trials these are stays hidden until their "
        "iteration is complete."
    )


def seconds_of_trial(store: SessionStore) -> float:
    """Median time of a trial in this session, else in the newest other one with its task and hardware; 0 if unknown."""
    facts = store.facts
    for name in (facts.name, *reversed(names(store.folder.parent))):
        try:
            other = SessionStore.open(store.folder.parent, name)
            alike = (other.facts.task, other.facts.hw) == (facts.task, facts.hw)
            took_s = [sum(trial.timing_s.values()) for trial in played_of(other)] if alike else []
        except SessionError:
            continue
        if took_s:
            return float(np.median(took_s))
    return 0.0
