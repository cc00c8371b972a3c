"""How many trials will a session need? Whole sessions are played in imagination, before the first real trial.

An imagined world is what the default method itself holds possible before any trial (`sim.adaptation.reality`):
parameters of the margin, and smooth discrepancies of that simulator. In each the whole session runs, with the same
learner, action errors and camera noise as on a table; beside every trial UDR acts in the same context.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, prospects_of
from sim.adaptation.learner import Learner
from sim.adaptation.method import FAILED, Trial, trials_of_rows
from sim.adaptation.methods import make_method
from sim.adaptation.methods.udr import Udr
from sim.adaptation.paired import ALPHA, capital
from sim.adaptation.reality import END, FACTORS_STD, LEAST_END_STD, SUCCESS, Discrepancy, Simulators
from sim.adaptation.sessions import begin_in_memory
from sim.adaptation.trials_forecast import MOST_PAIRS, PairsNeeded, SessionShare, TrialsForecast, TrialsNeeded
from sim.solvers.solver import SolvedPolicy, policy_for

SESSIONS = 64
"""Imagined sessions: the share of one in five is then known to 5 %."""

ITERATIONS = 5
"""Of an imagined session, as in the paper."""

DIFFERENCES = (0.1, 0.2, 0.4)
"""Gains over UDR for which the table says when they are shown."""

ALIKE = 16
"""Imagined sessions whose difference is nearest to the one in question, and which stand for it."""

_FUTURES = 400


@dataclass(frozen=True, eq=False)
class ImaginedWorld:
    """One possible reality: a simulator with its own discrepancies."""

    simulators: Simulators
    parameters: Array  # (p,) in units
    seed: int  # of the discrepancies
    factors: Array  # (1 + k,) by which their usual sizes are multiplied

    def play(self, contexts: Array, actions: Array, rng: np.random.Generator) -> tuple[Trial, ...]:
        """Trials at contexts (N, c) by commanded actions (N, a)."""
        task, solver, n = self.simulators.task, self.simulators.solver, len(contexts)
        executed = actions + rng.uniform(-1.0, 1.0, actions.shape) * task.action_noise
        nuisance, where = task.nuisance.sample(rng, n), np.tile(self.parameters, (n, 1))
        success, end = (values.mean(axis=0) for values in solver.outcomes(where, executed, nuisance))
        at, (missed, *off) = task.action.normalise(actions), self._discrepancies
        is_success = rng.uniform(size=n) < success + missed.drawn(at, np.zeros((0, 1)), self.seed)[:, 0]
        apart = [one.drawn(at, np.zeros((0, 1)), self.seed + i)[:, 0] for i, one in enumerate(off, start=1)]
        noise = LEAST_END_STD * rng.standard_normal((n, len(off)))
        ends = end + (np.stack(apart, axis=-1) + noise) * self.simulators.end_unit
        rewards = np.where(is_success, [task.reward_of_success(e, c) for e, c in zip(ends, contexts, strict=True)], 0.0)
        paths = task.relocate(solver.trajectories(where, executed, nuisance), contexts)
        observations = task.observation.with_noise(paths, rng)
        shown = [one if ok else None for one, ok in zip(ends, is_success, strict=True)]
        return trials_of_rows(contexts, actions, observations, np.clip(rewards, 0.0, 1.0), shown)

    @cached_property
    def _discrepancies(self) -> list[Discrepancy]:
        nothing, nowhere = np.zeros(0), np.zeros((0, len(self.simulators.task.action)))
        scales = (SUCCESS, *[END] * len(self.simulators.end_unit))
        return [Discrepancy(s.times(f), nowhere, nothing) for s, f in zip(scales, self.factors, strict=True)]


@dataclass(frozen=True, eq=False)
class ImaginedSession:
    """The course of a session in one imagined world."""

    first_success: int | None  # trials until the end of the iteration with the first one; None: none succeeded
    stop: int | None  # trials until the verdict says stop; None: it never did
    differences: Array  # (n,) rewards minus those of UDR beside them, from the second iteration on, as with --control


def forecast(
    checkpoint: Checkpoint,
    particles: int = 2,
    seed: int = 0,
    sessions: int = SESSIONS,
    progress: Callable[[int, int], None] | None = None,
) -> TrialsForecast:
    """Play imagined sessions and count. Raises CheckpointError if the checkpoint cannot predict."""
    task = checkpoint.solver.task
    budget = ITERATIONS * particles * task.adaptation.trials_per_iteration
    played = imagine(checkpoint, budget, particles, seed, sessions, progress)
    return TrialsForecast(
        task=task.name,
        checkpoint_sha256=checkpoint.sha256,
        particles=particles,
        sessions=sessions,
        trials=budget,
        seed=seed,
        first_success=needed([one.first_success for one in played]),
        stop=needed([one.stop for one in played]),
        shown=tuple(
            PairsNeeded(difference=gain, **needed(pairs_until_shown(played, gain, seed)).model_dump())
            for gain in DIFFERENCES
        ),
    )


def imagine(
    checkpoint: Checkpoint,
    budget: int,
    particles: int = 2,
    seed: int = 0,
    sessions: int = SESSIONS,
    progress: Callable[[int, int], None] | None = None,
) -> list[ImaginedSession]:
    """Play the sessions of the default method, each of `budget` trials.

    Raises CheckpointError if the checkpoint cannot predict.
    """
    task = checkpoint.solver.task
    simulators = Simulators(checkpoint.solver, prospects_of("adaptsim", task, checkpoint))
    udr = policy_for(checkpoint.solver, Udr(task).start(1, np.random.default_rng(seed))[0].samples)
    played = []
    for number in range(sessions):
        played.append(_played(checkpoint, _world(simulators, seed, number), udr, budget, particles, (seed, number)))
        if progress is not None:
            progress(number + 1, sessions)
    return played


def _world(simulators: Simulators, seed: int, number: int) -> ImaginedWorld:
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number, 0)))
    truths = simulators.truths
    factors = np.exp(FACTORS_STD * rng.standard_normal(1 + len(simulators.end_unit)))
    return ImaginedWorld(simulators, truths[rng.integers(len(truths))], int(rng.integers(2**31)), factors)


def _played(
    checkpoint: Checkpoint, world: ImaginedWorld, udr: SolvedPolicy, budget: int, particles: int, which: tuple[int, int]
) -> ImaginedSession:
    task, each = checkpoint.solver.task, checkpoint.solver.task.adaptation.trials_per_iteration
    rng = np.random.default_rng(np.random.SeedSequence(which[0], spawn_key=(which[1], 1)))
    rewards, control, stop = list[float](), list[float](), None

    def play(policy: SolvedPolicy, iteration: int, particle: int) -> tuple[Trial, ...]:
        contexts = task.context.sample(rng, each)
        trials = world.play(contexts, np.stack([policy(context) for context in contexts]), rng)
        expected = [policy.predict(context)[0] for context in contexts]
        trials = tuple(replace(trial, predicted=e) for trial, e in zip(trials, expected, strict=True))
        rewards.extend(trial.reward for trial in trials)
        control.extend(trial.reward for trial in world.play(contexts, udr.actions(contexts), rng))
        return trials

    learner = Learner(make_method("adaptsim", task, checkpoint), checkpoint.solver, checkpoint.solver)
    session = begin_in_memory(learner, play, (particles, each), rng, lambda _: rng)
    for history in session.iterations(budget // (particles * each)):
        if stop is None and learner.judge(history).verdict.stops:
            stop = len(rewards)
    succeeded = np.flatnonzero(np.array(rewards) > FAILED)
    first = particles * each * (int(succeeded[0]) // (particles * each) + 1) if len(succeeded) else None
    return ImaginedSession(first, stop, (np.array(rewards) - np.array(control))[particles * each :])


def needed(counts: Sequence[int | None]) -> TrialsNeeded:
    """The trials that half, and four of five, of these sessions need; None: more than were played."""
    return TrialsNeeded(half=_share(counts, 0.5), four_of_five=_share(counts, 0.8))


def _share(counts: Sequence[int | None], least: float) -> SessionShare:
    """The least count that at least `least` of the sessions do not exceed, and the share that do not."""
    for most in sorted({count for count in counts if count is not None}):
        share = sum(count is not None and count <= most for count in counts) / len(counts)
        if share >= least:
            return SessionShare(most=most, share=share)
    return SessionShare(share=sum(count is not None for count in counts) / len(counts))


def pairs_until_shown(sessions: Sequence[ImaginedSession], difference: float, seed: int = 0) -> list[int | None]:
    """Pairs until a gain of `difference` over UDR is shown, in futures drawn from the sessions nearest to it."""
    rng = np.random.default_rng(seed)
    means = np.array([one.differences.mean() for one in sessions])
    nearest = np.argsort(np.abs(means - difference), kind="stable")[:ALIKE]
    counts = list[int | None]()
    for index in nearest:
        own = sessions[index].differences
        moved = np.clip(own + difference - own.mean(), -1.0, 1.0)
        drawn = rng.choice(moved, (_FUTURES // ALIKE, MOST_PAIRS))
        is_shown = capital(drawn, np.zeros(len(drawn))) >= 2.0 / ALPHA
        counts += [int(row.argmax()) + 1 if row.any() else None for row in is_shown]
    return counts
