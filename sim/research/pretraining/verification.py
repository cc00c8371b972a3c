"""Tests whether a checkpoint's card still holds, by comparing a few fresh rollouts with the held-out figures of
pretraining.

The draws are new, so nothing is compared digit by digit: a figure holds unless it is worse than the card's by more than
`SIGMAS` joint standard errors. This tests simulator, emulator and policies on this machine and version.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hw.types import Array
from sim.adaptation.card import Card, EvaluationReport
from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.methods import make_method
from sim.adaptation.methods.udr import udr_policies
from sim.research.pretraining.evaluation import EvaluationSettings, final_policies
from sim.research.pretraining.meta_training import sample_targets
from sim.rollouts.dataset import draw_requests
from sim.rollouts.draws import trial_requests
from sim.rollouts.run import Progress, Roll, roll_in_parts
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.training import held_out_errors
from sim.tasks.task import SolvedPolicy, Solver, Task
from sim.types import EmulatorReport

SIGMAS = 3.0
"""By chance, one figure in 700 counts as worse."""

ROUNDING = 1e-3
"""A change that another processor may cause; it never counts."""

PER_TARGET = 2
"""Rollouts of a policy per target if they are expensive: many targets are more informative than many rollouts."""

EXACT_TARGETS, ASKED_A_TARGET = 64, 3
"""The largest number of targets if rollouts are nearly free, and the number of requested rollouts for each target."""

AT_ONCE = 16
"""Rollouts between two reports of progress."""

Better = Literal["more", "less", "neither"]


@dataclass(frozen=True)
class CardFigure:
    """One figure of the card beside the present one."""

    name: str
    card: float
    measured: float
    tolerance: float  # largest acceptable deterioration
    better: Better

    @property
    def holds(self) -> bool:
        """Whether it is not worse than the card's by more than the tolerance."""
        gap = self.measured - self.card
        worse = {"more": -gap, "less": gap, "neither": abs(gap)}[self.better]
        return bool(worse <= self.tolerance)


def verify_figures(
    checkpoint: Checkpoint, roll: Roll, rollouts: int, seed: int, progress: Progress
) -> list[CardFigure]:
    """The figures of the card that about `rollouts` true rollouts can test.

    If rollouts are nearly free, whole sessions are run; more requested rollouts give more targets. Empty if the
    checkpoint has neither an emulator nor exact policies, because then there is nothing to test before a session trains
    its policies.
    """
    solver, rng = checkpoint.solver, np.random.default_rng(seed)
    task, card = solver.task, checkpoint.card
    if task.exact is not None:
        return _sessions(checkpoint, roll, _exact_targets(rollouts), rng, progress)
    if checkpoint.emulator is None:
        return []
    counted = roll_in_parts(roll, AT_ONCE, rollouts, progress)
    draws = max(AT_ONCE, 2 * rollouts // 3)
    targets = max(4, (rollouts - draws) // (2 * PER_TARGET))
    return [
        *_emulator(checkpoint.emulator, card.emulator, counted, draws, rng),
        *_policies(solver, card, counted, targets, rng),
    ]


def _emulator(
    emulator: Emulator, stated: EmulatorReport | None, roll: Roll, count: int, rng: np.random.Generator
) -> list[CardFigure]:
    """Held-out errors of the emulator on `count` draws over the margin, as in its report; none without a report."""
    if stated is None or not stated.held_out:
        return []
    requests = draw_requests(emulator.task, count, rng)
    errors = held_out_errors(emulator, requests, roll(requests))
    figures: dict[str, tuple[Better, Callable[[Array], float]]] = {
        "accuracy": ("more", _mean),
        "brier": ("less", _mean),
        "position_error_median": ("less", _median),
        "end_state_error_median": ("less", _median),
    }
    return [
        _figure(f"emulator: {name.replace('_', ' ')}", claim, stated.held_out, errors[name], better, statistic, rng)
        for name, (better, statistic) in figures.items()
        if math.isfinite(claim := getattr(stated, name)) and len(errors[name]) > 1
    ]


def _policies(solver: Solver, card: Card, roll: Roll, count: int, rng: np.random.Generator) -> list[CardFigure]:
    """Rewards of the policy for all of Omega in `count` random targets, and the emulator's errors about them."""
    task, stated = solver.task, card.evaluation
    targets = sample_targets(task, card.budget.evaluation.kind, count, rng)
    udr = udr_policies(solver, rng)
    own = solver.policies(task.parameters.sample(rng, count)[:, None], rng)
    earned, bias = np.zeros((count, 2)), np.zeros((count, 2))
    for i, target in enumerate(targets):
        for j, policy in enumerate((udr[i % len(udr)], own[i])):
            contexts = task.context.sample(rng, PER_TARGET)
            where = np.tile(target, (PER_TARGET, 1))
            requests = trial_requests(task, where, contexts, policy.actions(contexts), rng)
            rewards = roll(requests).rewards(task, contexts)
            predictions = solver.trial_rewards(requests.parameters, contexts, requests.action, requests.nuisance)
            earned[i, j], bias[i, j] = rewards.mean(), (predictions - rewards).mean()
    if stated is None:
        return []
    of_all, added = "mean reward of the policy for all ranges", "reward that the emulator adds"
    return [
        _figure(of_all, stated.udr, stated.targets, earned[:, 0], "more", _mean, rng),
        _figure(added, stated.emulator_bias, stated.targets, bias.mean(axis=1), "neither", _mean, rng),
    ]


def _exact_targets(rollouts: int) -> int:
    return max(4, min(EXACT_TARGETS, rollouts // ASKED_A_TARGET))


def _best(stated: EvaluationReport | None) -> str:
    """The adapting method that earned most in the evaluation of the card."""
    scores = [score for score in stated.methods if score.name != "random"] if stated else []
    return max(scores, key=lambda score: score.reward[-1]).name if scores else "adaptsim-belief"


def _sessions(
    checkpoint: Checkpoint, roll: Roll, count: int, rng: np.random.Generator, progress: Progress
) -> list[CardFigure]:
    """Whole sessions in `count` fresh targets, for a task with nearly free rollouts."""
    solver, card = checkpoint.solver, checkpoint.card
    task, judging, stated = solver.task, card.budget.evaluation, card.evaluation
    settings = EvaluationSettings(kind=judging.kind, particles=judging.particles, iterations=judging.iterations)
    name = _best(stated)
    method, udr = make_method(name, task, checkpoint), udr_policies(solver, rng)
    earned: dict[str, list[float]] = {name: [], "udr": []}
    for i, target in enumerate(sample_targets(task, settings.kind, count, rng)):
        final = final_policies(solver, method, target, roll, settings, rng)[-1]
        earned[name].append(_earned(task, final, target, roll, rng))
        earned["udr"].append(_earned(task, udr[i % len(udr)], target, roll, rng))
        progress(i + 1, count)
    if stated is None:
        return []
    claims = {score.name: score.reward[-1] for score in stated.methods} | {"udr": stated.udr}
    return [
        _figure(f"mean reward of {of}", claims[of], stated.targets, np.array(values), "more", _mean, rng)
        for of, values in earned.items()
        if of in claims
    ]


def _earned(task: Task, policy: SolvedPolicy, target: Array, roll: Roll, rng: np.random.Generator) -> float:
    contexts = task.context.sample(rng, 1)
    return float(
        roll(trial_requests(task, target[None], contexts, policy.actions(contexts), rng)).rewards(task, contexts)[0]
    )


def _figure(
    name: str,
    card: float,
    behind: int,
    values: Array,
    better: Better,
    statistic: Callable[[Array], float],
    rng: np.random.Generator,
) -> CardFigure:
    """`behind` is the number of values behind the card's figure; their spread is assumed to be that of `values`."""
    drawn = values[rng.integers(len(values), size=(1000, len(values)))]
    error = float(np.std([statistic(row) for row in drawn]))
    both = error * float(np.sqrt(1.0 + len(values) / behind))
    return CardFigure(name, card, statistic(values), max(ROUNDING, SIGMAS * both), better)


def _mean(values: Array) -> float:
    return float(values.mean())


def _median(values: Array) -> float:
    return float(np.median(values))
