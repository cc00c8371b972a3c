"""Evaluation of Phase 1: sessions on unseen targets, with every final reward by true rollouts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce

import numpy as np

from hw.types import Array
from sim.adaptation.adaptation import Adaptation
from sim.adaptation.card import EvaluationReport, MethodScore, Targets
from sim.adaptation.method import Method, Trial
from sim.adaptation.methods.udr import udr_policies
from sim.adaptation.sessions import begin_in_memory
from sim.research.pretraining.episodes import simulated_trials
from sim.research.pretraining.meta_training import sample_targets
from sim.rollouts.draws import cover, trial_requests
from sim.rollouts.run import Requests, Roll
from sim.tasks.task import Executable, SolvedPolicy, Solver, SolverSettings, Task

LEAST_GAP = 0.1
"""Targets with a smaller difference between oracle and UDR say nothing about adaptation."""

PROPOSED, SCREENING = 4, 8
"""Number of policies among which true rollouts choose the oracle, and rollouts of each."""


@dataclass(frozen=True)
class EvaluationSettings:
    """The number of targets and the resolution of the evaluation."""

    targets: int = 40
    kind: Targets = "paper"
    particles: int = 2
    iterations: int = 5
    rollouts: int = 8  # true ones behind each final reward
    oracle: int = 128  # candidate parameter vectors of the oracle in Omega


@dataclass(frozen=True, eq=False)
class KnownPolicies:
    """`Policies` of a solver, each distribution's trained once: sessions come back to the same particles."""

    solver: Solver
    _solved: dict[bytes, tuple[SolvedPolicy, ...]] = field(default_factory=dict)

    @property
    def task(self) -> Task:
        """See `Policies`."""
        return self.solver.task

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[SolvedPolicy, ...]:
        """See `Policies`. Equal samples get the same policy, because a session always uses the same draws
        (`policy_for`).
        """
        key = samples.tobytes()
        if key not in self._solved:
            self._solved[key] = self.solver.policies(samples, rng, executable, settings)
        return self._solved[key]


def final_policies(
    solver: Solver,
    method: Method,
    target: Array,
    roll: Roll,
    settings: EvaluationSettings,
    rng: np.random.Generator,
) -> list[SolvedPolicy]:
    """The final policies that a session of `method` in a simulated target (p,) would have if it ended after each
    iteration.
    """
    task = solver.task
    adaptation = Adaptation(method, KnownPolicies(solver), solver)

    def play(policy: SolvedPolicy, iteration: int, particle: int) -> tuple[Trial, ...]:
        return simulated_trials(task, policy, target, roll, task.adaptation.trials_per_iteration, rng)

    shape = (settings.particles, task.adaptation.trials_per_iteration)
    session = begin_in_memory(adaptation, play, shape, rng, lambda _: rng)
    return [adaptation.final(history) for history in session.iterations(settings.iterations)]


def evaluate(
    solver: Solver,
    methods: Mapping[str, Method],
    roll: Roll,
    settings: EvaluationSettings,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> EvaluationReport:
    """Compare `methods` with UDR and the oracle on `settings.targets` unseen targets, after every iteration."""
    task = solver.task
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(settings.targets + 1)]
    targets = sample_targets(task, settings.kind, settings.targets, streams[0])
    grid = cover(task.parameters, settings.oracle, streams[0])
    candidates = solver.policies(grid[:, None, :], streams[0])
    udr = udr_policies(solver, streams[0])
    true, solved = list[Array](), list[Array]()
    for i, (target, rng) in enumerate(zip(targets, streams[1:], strict=True)):
        fixed = [*udr, _oracle(solver, candidates, target, roll, rng)]
        chosen = [
            policy
            for method in methods.values()
            for policy in final_policies(solver, method, target, roll, settings, rng)
        ]
        judged = _judge(solver, fixed + chosen, target, roll, settings.rollouts, rng)
        for rewards, means in zip((true, solved), judged, strict=True):
            rewards.append(np.concatenate([[means[: len(udr)].mean()], means[len(udr) :]]))
        if progress is not None:
            progress(i + 1, settings.targets)
    return _report(task, list(methods), np.array(true), np.array(solved), settings, np.random.default_rng(seed))


def _oracle(
    solver: Solver, candidates: tuple[SolvedPolicy, ...], target: Array, roll: Roll, rng: np.random.Generator
) -> SolvedPolicy:
    """The best policy of parameters in Omega. The solver, which knows the target, proposes some, and true rollouts
    choose one.
    """
    contexts = solver.task.context.sample(rng, 4)
    actions = np.stack([policy.actions(contexts) for policy in candidates])
    rewards = solver.expected_rewards(np.tile(target, (len(candidates), 1)), contexts, actions, rng)
    proposed = [candidates[i] for i in np.argsort(-rewards)[:PROPOSED]]
    true, _ = _judge(solver, proposed, target, roll, SCREENING, rng)
    best: SolvedPolicy = proposed[int(np.argmax(true))]
    return best


def _judge(
    solver: Solver, policies: Sequence[SolvedPolicy], target: Array, roll: Roll, n: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Two arrays (len(policies),) on the same contexts, errors and nuisance: the true mean rewards, and those that the
    solver predicts.

    A repeated policy is judged once; all are simulated together, so that no worker waits.
    """
    task = solver.task
    contexts = task.context.sample(rng, n)
    seed = int(rng.integers(2**31))
    distinct = list({id(policy): policy for policy in policies}.values())
    parts = [
        trial_requests(task, np.tile(target, (n, 1)), contexts, policy.actions(contexts), np.random.default_rng(seed))
        for policy in distinct
    ]
    everything = reduce(Requests.followed_by, parts)
    everywhere = np.tile(contexts, (len(distinct), 1))
    true = roll(everything).rewards(task, everywhere)
    expected = solver.trial_rewards(everything.parameters, everywhere, everything.action, everything.nuisance)
    means = np.stack([true, expected]).reshape(2, len(distinct), n).mean(axis=-1)
    place = {id(policy): i for i, policy in enumerate(distinct)}
    rewards = means[:, [place[id(policy)] for policy in policies]]
    return rewards[0], rewards[1]


def _report(
    task: Task,
    names: Sequence[str],
    true: Array,
    solved: Array,
    settings: EvaluationSettings,
    rng: np.random.Generator,
) -> EvaluationReport:
    """The report from rewards (targets, 2 + methods * iterations): UDR, oracle, each method after each iteration."""
    udr, oracle = true[:, 0], true[:, 1]
    gap = oracle - udr >= LEAST_GAP
    curves = true[:, 2:].reshape(len(true), len(names), settings.iterations)
    scores = []
    for name, curve in zip(names, np.moveaxis(curves, 1, 0), strict=True):
        gain = curve - udr[:, None]
        closed = [_closed(gain[gap, k], (oracle - udr)[gap], rng) for k in range(settings.iterations)]
        drawn = rng.integers(len(gain), size=(2000, len(gain)))
        low, high = np.quantile(gain[drawn, -1].mean(axis=1), [0.025, 0.975])
        scores.append(
            MethodScore(
                name=name,
                reward=tuple(float(m) for m in curve.mean(axis=0)),
                gap_closed=tuple(c[0] for c in closed),
                gap_closed_ci95=tuple(c[1] for c in closed),
                above_udr_ci95=(float(low), float(high)),
            )
        )
    spread_enough = true.std() > 1e-9 and solved.std() > 1e-9
    return EvaluationReport(
        kind=settings.kind,
        targets=len(true),
        trials=settings.particles * settings.iterations * task.adaptation.trials_per_iteration,
        rollouts=settings.rollouts,
        udr=float(udr.mean()),
        oracle=float(oracle.mean()),
        targets_with_gap=int(gap.sum()),
        methods=tuple(scores),
        pairs=int(true.size),
        emulator_correlation=float(np.corrcoef(true.ravel(), solved.ravel())[0, 1]) if spread_enough else 0.0,
        emulator_bias=float((solved - true).mean()),
    )


def _closed(gain: Array, gap: Array, rng: np.random.Generator) -> tuple[float, tuple[float, float]]:
    """Share of the gap closed, pooled over targets (n,), with its 95 % bootstrap interval."""
    if len(gap) == 0:
        return 0.0, (0.0, 0.0)
    drawn = rng.integers(len(gap), size=(2000, len(gap)))
    low, high = np.quantile(gain[drawn].sum(axis=1) / gap[drawn].sum(axis=1), [0.025, 0.975])
    return float(gain.sum() / gap.sum()), (float(low), float(high))
