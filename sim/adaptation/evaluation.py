"""Phase 1, judged: sessions on unseen targets, every final reward by true rollouts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hw.types import Array
from sim.adaptation.best import choose_best
from sim.adaptation.episodes import Roll, simulated_trials, trial_requests
from sim.adaptation.meta_training import Targets, sample_targets
from sim.adaptation.method import Iteration, Method, ParticleTrials
from sim.adaptation.phase2 import AdaptSim
from sim.adaptation.q_network import QNetwork
from sim.baselines.random_search import RandomSearch
from sim.baselines.udr import Udr
from sim.sampling import sobol, spread
from sim.solver import SolvedPolicy, Solver, policy_for
from sim.tasks.task import Task

LEAST_GAP = 0.1
"""Targets where oracle and UDR lie closer than this say nothing about adaptation."""


@dataclass(frozen=True)
class EvaluationSettings:
    """How many targets are judged, and how finely."""

    targets: int = 40
    kind: Targets = "paper"
    particles: int = 2
    iterations: int = 5
    rollouts: int = 16  # true rollouts behind each final reward
    oracle: int = 128  # parameter vectors in Omega that the oracle may choose from


@dataclass(frozen=True)
class EvaluationReport:
    """Mean rewards over the targets, all by true rollouts; a pair is (policy, target)."""

    targets: int
    trials: int  # a session
    rollouts: int  # behind each reward
    adaptsim: float
    random: float
    udr: float
    oracle: float
    targets_with_gap: int  # oracle - udr at least LEAST_GAP
    gap_closed: float  # pooled over those targets; 0 when there is none
    gap_closed_ci95: tuple[float, float]  # bootstrap over targets
    pairs: int
    emulator_correlation: float  # of the solver's rewards with true ones over the pairs; 1 for an exact solver
    emulator_bias: float  # mean of the solver's - true; 0 for an exact solver


def run_session(
    solver: Solver,
    method: Method,
    target: Array,
    roll: Roll,
    settings: EvaluationSettings,
    rng: np.random.Generator,
) -> list[Iteration]:
    """A whole session of `method` in a simulated target (p,), as on the real one."""
    task = solver.task
    history: list[Iteration] = []
    particles = method.start(settings.particles, rng)
    for _ in range(settings.iterations):
        seen = []
        for particle in particles:
            policy = policy_for(solver, particle.samples, rng)
            trials = simulated_trials(task, policy, target, roll, task.adaptation.trials_per_iteration, rng)
            seen.append(ParticleTrials(particle, trials))
        history.append(tuple(seen))
        particles = method.next(history, rng)
    return history


def evaluate(
    solver: Solver,
    network: QNetwork,
    roll: Roll,
    settings: EvaluationSettings,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> EvaluationReport:
    """Compare AdaptSim with random best-of-n, UDR and the oracle on `settings.targets` unseen targets."""
    task = solver.task
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(settings.targets + 1)]
    targets = sample_targets(task, settings.kind, settings.targets, streams[0])
    grid = spread(task.parameters, sobol(settings.oracle, len(task.parameters), streams[0]))
    candidates = solver.policies(grid[:, None, :], streams[0])
    udr = policy_for(solver, Udr(task).start(1, streams[0])[0].samples, streams[0])
    true, emulated = [], []
    for i, (target, rng) in enumerate(zip(targets, streams[1:], strict=True)):
        policies = [
            _final(solver, AdaptSim(task, network), target, roll, settings, rng),
            _final(solver, RandomSearch(task), target, roll, settings, rng),
            udr,
            _oracle(solver, candidates, target, rng),
        ]
        rewards = _judge(solver, policies, target, roll, settings.rollouts, rng)
        true.append(rewards[0])
        emulated.append(rewards[1])
        if progress is not None:
            progress(i + 1, settings.targets)
    return _report(task, np.array(true), np.array(emulated), settings, np.random.default_rng(seed))


def _final(
    solver: Solver,
    method: Method,
    target: Array,
    roll: Roll,
    settings: EvaluationSettings,
    rng: np.random.Generator,
) -> SolvedPolicy:
    best = choose_best(solver.task, run_session(solver, method, target, roll, settings, rng))
    return policy_for(solver, best.particle.samples, rng)


def _oracle(
    solver: Solver, candidates: tuple[SolvedPolicy, ...], target: Array, rng: np.random.Generator
) -> SolvedPolicy:
    """The policy of the parameters in Omega that the solver, knowing the target, expects most of."""
    contexts = solver.task.context.sample(rng, 4)
    actions = np.stack([policy.actions(contexts) for policy in candidates])
    rewards = solver.expected_rewards(np.tile(target, (len(candidates), 1)), contexts, actions, rng)
    return candidates[int(np.argmax(rewards))]


def _judge(
    solver: Solver,
    policies: list[SolvedPolicy],
    target: Array,
    roll: Roll,
    n: int,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """True and emulated mean rewards (len(policies),) on the same contexts, errors and nuisance."""
    task = solver.task
    contexts = task.context.sample(rng, n)
    seed = int(rng.integers(2**31))
    true, emulated = [], []
    for policy in policies:
        actions = policy.actions(contexts)
        request = trial_requests(task, np.tile(target, (n, 1)), contexts, actions, np.random.default_rng(seed))
        true.append(float(roll(request).rewards(task, contexts).mean()))
        expected = solver.trial_rewards(request.parameters, contexts, request.action, request.nuisance)
        emulated.append(float(expected.mean()))
    return np.array(true), np.array(emulated)


def _report(
    task: Task, true: Array, emulated: Array, settings: EvaluationSettings, rng: np.random.Generator
) -> EvaluationReport:
    adapted, _, udr, oracle = true.T
    gap = oracle - udr >= LEAST_GAP
    low, high = _bootstrap((adapted - udr)[gap], (oracle - udr)[gap], rng)
    spread_enough = true.std() > 1e-9 and emulated.std() > 1e-9
    means = [float(m) for m in true.mean(axis=0)]
    return EvaluationReport(
        targets=len(true),
        trials=settings.particles * settings.iterations * task.adaptation.trials_per_iteration,
        rollouts=settings.rollouts,
        adaptsim=means[0],
        random=means[1],
        udr=means[2],
        oracle=means[3],
        targets_with_gap=int(gap.sum()),
        gap_closed=float((adapted - udr)[gap].sum() / (oracle - udr)[gap].sum()) if gap.any() else 0.0,
        gap_closed_ci95=(low, high),
        pairs=int(true.size),
        emulator_correlation=float(np.corrcoef(true.ravel(), emulated.ravel())[0, 1]) if spread_enough else 0.0,
        emulator_bias=float((emulated - true).mean()),
    )


def _bootstrap(gain: Array, gap: Array, rng: np.random.Generator) -> tuple[float, float]:
    if len(gain) == 0:
        return 0.0, 0.0
    rows = rng.integers(len(gain), size=(2000, len(gain)))
    low, high = np.quantile(gain[rows].sum(axis=1) / gap[rows].sum(axis=1), [0.025, 0.975])
    return float(low), float(high)
