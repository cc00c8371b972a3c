"""How many trials will a session need? Whole sessions are played in imagination, before the first real trial.

An imagined world is one that the default method holds possible before any trial (`sim.adaptation.outcome_posterior`):
parameters of the margin, and smooth discrepancies of that simulator. In each the whole session runs, with the same
adaptation, action errors and camera noise as on a table; beside every trial UDR acts in the same context.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hw.types import Array
from sim.adaptation.adaptation import Adaptation
from sim.adaptation.checkpoint import Checkpoint, reward_table_of
from sim.adaptation.discrepancy import END, FACTORS_STD, LEAST_END_STD, SUCCESS, Discrepancy
from sim.adaptation.method import FAILED, Iteration, Trial, trials_in, trials_of_rows
from sim.adaptation.methods import make_method
from sim.adaptation.methods.udr import Udr
from sim.adaptation.paired import is_gain_shown
from sim.adaptation.sessions import begin_in_memory
from sim.adaptation.simulators import Simulators
from sim.adaptation.trials_forecast import MOST_PAIRS, PairsNeeded, SessionShare, TrialsForecast, TrialsNeeded
from sim.adaptation.verdict import Kind
from sim.solvers.solver import policy_for
from sim.tasks.task import SolvedPolicy

SESSIONS = 64
"""Number of imagined sessions. The share of one session in five is then known to 5 %."""

ITERATIONS = 5
"""Iterations of an imagined session, as in the paper."""

DIFFERENCES = (0.1, 0.2, 0.4)
"""Gains over UDR for which the table states the number of pairs."""

ALIKE = 16
"""A difference is represented by the imagined sessions with the nearest differences; this is their number."""

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
        predicted = solver.outcomes(where, executed, nuisance, contexts).mean_of_ensemble
        at, (missed, *off) = self.simulators.places(actions, contexts), self._discrepancies
        is_success = rng.uniform(size=n) < predicted.success + missed.drawn(at, np.zeros((0, 1)), self.seed)[:, 0]
        apart = [one.drawn(at, np.zeros((0, 1)), self.seed + i)[:, 0] for i, one in enumerate(off, start=1)]
        noise = LEAST_END_STD * rng.standard_normal((n, len(off)))
        ends = predicted.end_state + (np.stack(apart, axis=-1) + noise) * self.simulators.end_unit
        failed = 0.0 if predicted.failure_reward is None else predicted.failure_reward
        earned = [task.reward_of_success(e, c) for e, c in zip(ends, contexts, strict=True)]
        rewards = np.where(is_success, earned, failed)
        paths = solver.trajectories(where, executed, nuisance, contexts)
        observations = task.observation.with_noise(paths, rng)
        shown = [one if ok else None for one, ok in zip(ends, is_success, strict=True)]
        return trials_of_rows(contexts, actions, observations, np.clip(rewards, 0.0, 1.0), shown)

    @cached_property
    def _discrepancies(self) -> list[Discrepancy]:
        nothing, nowhere = np.zeros(0), np.zeros((0, self.simulators.place_size))
        scales = (SUCCESS, *[END] * len(self.simulators.end_unit))
        return [Discrepancy(s.times(f), nowhere, nothing) for s, f in zip(scales, self.factors, strict=True)]


Play = Callable[[Array, Array, np.random.Generator], tuple[Trial, ...]]
"""Trials of a world at contexts (N, c) by commanded actions (N, a)."""


@dataclass(frozen=True, eq=False)
class SessionCourse:
    """A whole session of the default method, with a control trial of UDR beside each of its trials."""

    adaptation: Adaptation
    history: tuple[Iteration, ...]
    control: Array  # (n,) rewards of the control trials
    kinds: tuple[Kind, ...]  # of the verdict after each iteration

    @property
    def trials(self) -> list[Trial]:
        """The session's own trials, in order; each knows its prediction."""
        return trials_in(self.history)

    @property
    def each(self) -> int:
        """Trials of an iteration."""
        return len(self.control) // len(self.history)

    @property
    def first_success(self) -> int | None:
        """Number of trials until the end of the iteration with the first reward above `FAILED`; None if there is no
        such reward.
        """
        rewarded = [trial.reward > FAILED for trial in self.trials]
        return self.each * (rewarded.index(True) // self.each + 1) if True in rewarded else None

    @property
    def differences(self) -> Array:
        """Rewards minus those of UDR beside them, from the second iteration on, as with `--control`."""
        return (np.array([trial.reward for trial in self.trials]) - self.control)[self.each :]


def course(
    checkpoint: Checkpoint,
    play_in: Play,
    udr: SolvedPolicy,
    rng: np.random.Generator,
    iterations: int = ITERATIONS,
    particles: int = 2,
) -> SessionCourse:
    """Play a session of the default method in a world. Raises CheckpointError if the checkpoint cannot predict."""
    task, each = checkpoint.solver.task, checkpoint.solver.task.adaptation.trials_per_iteration
    control = list[float]()

    def play(policy: SolvedPolicy, iteration: int, particle: int) -> tuple[Trial, ...]:
        contexts = task.context.sample(rng, each)
        trials = play_in(contexts, np.stack([policy(context) for context in contexts]), rng)
        control.extend(trial.reward for trial in play_in(contexts, udr.actions(contexts), rng))
        expected = [policy.predict(context)[0] for context in contexts]
        return tuple(replace(trial, predicted=one) for trial, one in zip(trials, expected, strict=True))

    adaptation = Adaptation(make_method("adaptsim", task, checkpoint), checkpoint.solver, checkpoint.solver)
    session = begin_in_memory(adaptation, play, (particles, each), rng, lambda _: rng)
    kinds, history = list[Kind](), tuple[Iteration, ...]()
    for history in session.iterations(iterations):
        kinds.append(adaptation.assess(history).verdict.kind)
    return SessionCourse(adaptation, history, np.array(control), tuple(kinds))


def forecast(
    checkpoint: Checkpoint,
    particles: int = 2,
    seed: int = 0,
    sessions: int = SESSIONS,
    progress: Callable[[int, int], None] | None = None,
) -> TrialsForecast:
    """Play imagined sessions and count. Raises CheckpointError if the checkpoint cannot predict."""
    task = checkpoint.solver.task
    played = imagine(checkpoint, ITERATIONS, particles, seed, sessions, progress)
    return TrialsForecast(
        task=task.name,
        checkpoint_sha256=checkpoint.sha256,
        particles=particles,
        sessions=sessions,
        trials=len(played[0].control),
        seed=seed,
        first_success=needed([one.first_success for one in played]),
        shown=tuple(
            PairsNeeded(
                difference=gain,
                **needed(pairs_until_shown([one.differences for one in played], gain, seed)).model_dump(),
            )
            for gain in DIFFERENCES
        ),
    )


def imagine(
    checkpoint: Checkpoint,
    iterations: int = ITERATIONS,
    particles: int = 2,
    seed: int = 0,
    sessions: int = SESSIONS,
    progress: Callable[[int, int], None] | None = None,
) -> list[SessionCourse]:
    """Play a session in each of `sessions` imagined worlds. Raises CheckpointError if the checkpoint cannot predict."""
    task = checkpoint.solver.task
    simulators = Simulators(checkpoint.solver, reward_table_of("adaptsim", task, checkpoint))
    udr = policy_for(checkpoint.solver, Udr(task).start(1, np.random.default_rng(seed))[0].samples)
    played = []
    for number in range(sessions):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number, 1)))
        played.append(course(checkpoint, _world(simulators, seed, number).play, udr, rng, iterations, particles))
        if progress is not None:
            progress(number + 1, sessions)
    return played


def _world(simulators: Simulators, seed: int, number: int) -> ImaginedWorld:
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number, 0)))
    truths = simulators.truths
    factors = np.exp(FACTORS_STD * rng.standard_normal(1 + len(simulators.end_unit)))
    return ImaginedWorld(simulators, truths[rng.integers(len(truths))], int(rng.integers(2**31)), factors)


def needed(counts: Sequence[int | None]) -> TrialsNeeded:
    """The trials that half and four fifths of these sessions need. None means more trials than were played."""
    return TrialsNeeded(half=_share(counts, 0.5), four_of_five=_share(counts, 0.8))


def _share(counts: Sequence[int | None], least: float) -> SessionShare:
    """The smallest count that at least a share `least` of the sessions does not exceed, and the share that does not
    exceed it.
    """
    for most in sorted({count for count in counts if count is not None}):
        share = sum(count is not None and count <= most for count in counts) / len(counts)
        if share >= least:
            return SessionShare(most=most, share=share)
    return SessionShare(share=sum(count is not None for count in counts) / len(counts))


def pairs_until_shown(sessions: Sequence[Array], difference: float, seed: int = 0) -> list[int | None]:
    """Pairs until a gain of `difference` over UDR is shown, in futures drawn from the sessions nearest to it.

    `sessions` holds the differences (n,) of each.
    """
    rng = np.random.default_rng(seed)
    means = np.array([own.mean() for own in sessions])
    nearest = np.argsort(np.abs(means - difference), kind="stable")[:ALIKE]
    counts = list[int | None]()
    for index in nearest:
        own = sessions[index]
        moved = np.clip(own + difference - own.mean(), -1.0, 1.0)
        drawn = rng.choice(moved, (_FUTURES // ALIKE, MOST_PAIRS))
        is_shown = is_gain_shown(drawn, MOST_PAIRS)
        counts += [int(row.argmax()) + 1 if row.any() else None for row in is_shown]
    return counts
