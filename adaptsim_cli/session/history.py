"""The trials of a stored session, in the form that learning methods take."""

from __future__ import annotations

import numpy as np

from adaptsim_cli.session.records import Samples, TrialRecord
from adaptsim_cli.session.store import SessionStore
from sim.adaptation.method import Iteration, Particle, ParticleTrials, Trial
from sim.tasks.task import Task


def particles_of(store: SessionStore, iteration: int) -> tuple[Particle, ...]:
    """The particles that an iteration's trials were (or will be) made with."""
    stored: tuple[Samples, ...] = store.start.particles
    if iteration > 0:
        result = store.result(iteration - 1)
        if result is None:
            raise ValueError(f"iteration {iteration - 1} has no result yet")
        stored = result.next_particles
    return tuple(Particle(np.array(samples)) for samples in stored)


def history_of(task: Task, store: SessionStore, last: int) -> tuple[Iteration, ...]:
    """The counting trials of iterations 0 to `last`, as learning methods take them. Raises SessionError."""

    def trials(iteration: int, particle: int) -> tuple[Trial, ...]:
        return tuple(_learnt_from(task, r) for r in store.trials(iteration) if r.particle == particle + 1)

    return tuple(
        tuple(ParticleTrials(p, trials(i, index)) for index, p in enumerate(particles_of(store, i)))
        for i in range(last + 1)
    )


def _learnt_from(task: Task, record: TrialRecord) -> Trial:
    return Trial(
        context=record.context_array,
        action=record.action_array,
        observation=np.array(record.observation),
        reward=record.reward,
        end_state=task.end_of(record.track.track()),
    )
