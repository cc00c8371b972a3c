"""The content of a stored session as values: its particles, trials and results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.screen.console import ANSWERING
from adaptsim_cli.session.records import ResultRecord, TrialRecord
from adaptsim_cli.session.store import SessionStore
from hw.types import Array
from sim.adaptation.method import Iteration, Particle, ParticleTrials, Trial
from sim.adaptation.stages import RunTrial

if TYPE_CHECKING:
    from sim.tasks.task import Task


def result_of(store: SessionStore, iteration: int) -> ResultRecord:
    """The newest result of an iteration. Raises SessionError if it has none."""
    if (result := store.result(iteration)) is None:
        raise SessionError(f"iteration {iteration + 1} of {store.facts.name} has no result yet")
    return result


def particles_of(store: SessionStore, iteration: int) -> tuple[Particle, ...]:
    """The particles that an iteration's trials were (or will be) made with. Raises SessionError."""
    stored = result_of(store, iteration - 1).next_particles if iteration else store.start.particles
    return tuple(Particle(np.array(samples)) for samples in stored)


def means_of(store: SessionStore, results: Sequence[ResultRecord]) -> Array:
    """(I + 1, n, p) the particles' means in every iteration of `results`, and in the next one."""
    steps = [store.start.particles, *(result.next_particles for result in results)]
    return np.array([[np.mean(samples, axis=0) for samples in particles] for particles in steps])


def history_of(task: Task, store: SessionStore, last: int) -> tuple[Iteration, ...]:
    """The counting trials of iterations 0 to `last`, as learning methods take them. Raises SessionError."""

    def iteration(i: int) -> Iteration:
        trials = store.trials(i)
        return tuple(
            ParticleTrials(particle, tuple(_learnt_from(task, one) for one in trials if one.particle == number))
            for number, particle in enumerate(particles_of(store, i), start=1)
        )

    return tuple(iteration(i) for i in range(last + 1))


def _learnt_from(task: Task, record: TrialRecord) -> Trial:
    return Trial(
        context=record.context_array,
        action=record.action_array,
        observation=np.array(record.observation, dtype=np.float64),
        reward=record.reward,
        end_state=task.end_of(record.track.track()),
        predicted=record.predicted_reward,
    )


def played_of(store: SessionStore) -> tuple[TrialRecord, ...]:
    """Every completed trial that counts, in order, control trials too. Raises SessionError."""
    return tuple(trial for i in range(store.iterations()) for trial in store.played(i))


def trials_of(store: SessionStore) -> tuple[TrialRecord, ...]:
    """Every completed trial that counts, in order; without control trials. Raises SessionError."""
    return tuple(trial for i in range(store.iterations()) for trial in store.trials(i))


def results_of(store: SessionStore) -> tuple[ResultRecord, ...]:
    """The newest result of every iteration that has one. Raises SessionError."""
    return tuple(result for i in range(store.iterations()) if (result := store.result(i)) is not None)


def completed(store: SessionStore, number: int) -> TrialRecord:
    """The completed trial `number` (from 1) that counts. Raises UsageError, which names the completed ones, or
    SessionError.
    """
    trials = {trial.trial: trial for trial in played_of(store)}
    if number not in trials:
        listing = ", ".join(map(str, trials)) or "none yet"
        raise UsageError(f"trial {number} of {store.facts.name} is not complete; complete trials: {listing}")
    return trials[number]


def left_s(store: SessionStore, stage: RunTrial) -> float:
    """The time (s) of the rest of the iteration without waiting for answers, if its trials take as long as those of
    this iteration or of the one before; 0 if there are none.
    """
    trials = store.played(stage.iteration) or (store.played(stage.iteration - 1) if stage.iteration else ())
    took_s = [sum(spent for name, spent in one.timing_s.items() if name != ANSWERING) for one in trials]
    missing = store.facts.layout.numbers(stage.iteration).stop - stage.key.number
    return missing * sum(took_s) / len(took_s) if took_s else 0.0
