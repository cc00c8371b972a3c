"""The record of an iteration's result: next particles, best parameters, verdict, forecast, control and times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptsim_cli.screen.outputs.trials import BestRecord, ForecastRecord, SuspicionRecord, as_row, named
from adaptsim_cli.screen.stopwatch import added
from adaptsim_cli.session import correcting
from adaptsim_cli.session.control import compared
from adaptsim_cli.session.history import played_of, trials_of
from adaptsim_cli.session.records import ResultRecord, Samples
from adaptsim_cli.session.store import SessionStore
from sim.adaptation.adaptation import Assessment
from sim.adaptation.method import Iteration, Particle, trials_in
from sim.adaptation.stages import Adapt, changes_until
from sim.tasks.task import Task

TOTAL = "total"


def iteration_result(
    task: Task,
    store: SessionStore,
    stage: Adapt,
    history: Sequence[Iteration],
    particles: Sequence[Particle],
    judgement: Assessment,
    overhead_s: dict[str, float],
    lap_s: dict[str, float],
) -> ResultRecord:
    """The result of the iteration that `stage` ends; `lap_s` are the seconds since its last trial, by stage, and
    `overhead_s` those of the iteration that belong to no trial.
    """
    records = store.played(stage.iteration)
    timing_s = added(*(record.timing_s for record in records), overhead_s, lap_s)
    names = task.parameters.names
    changes = changes_until(store.existing(), stage.iteration)
    numbers = [trial.trial for trial in trials_of(store)]
    change_count = max(
        (one.changes for i in range(stage.iteration + 1) if (one := store.result(i)) is not None), default=0
    )
    return ResultRecord(
        iteration=stage.iteration + 1,
        trials=tuple((key.number, key.attempt + 1) for key in stage.keys),
        next_particles=tuple(rows_of(particle) for particle in particles),
        best=BestRecord(
            params=named(names, judgement.best.particle.mean),
            mean_reward=judgement.best.mean_reward,
            trials=judgement.best.trials,
            ci95=judgement.best.ci95,
            tried=tuple(numbers[number - 1] for number in judgement.tried),
            tried_reward=_mean_reward(history, judgement.tried),
            chosen_after=_chosen_after(history, judgement.tried),
        ),
        verdict=judgement.verdict,
        outlook=None if judgement.forecast is None else ForecastRecord.of(judgement.forecast),
        suspicion=_suspicion(task, store),
        control=compared(store.facts, played_of(store)),
        timing_s={**timing_s, TOTAL: sum(timing_s.values())},
        proposal_s=sum(lap_s.values()) + sum(records[-1].timing_s.get(name, 0.0) for name in ("tracking", "storing")),
        changes=changes,
        amended=correcting.sentences(store, stage.iteration, change_count),
    )


def _suspicion(task: Task, store: SessionStore) -> SuspicionRecord | None:
    """The fault of the rig that the trials so far suggest, according to the task."""
    hardware = task.hardware
    if hardware is None:
        return None
    suspicion = hardware.suspect([record.track.track() for record in played_of(store)])
    return None if suspicion is None else SuspicionRecord.of(suspicion)


def _mean_reward(history: Sequence[Iteration], trials: tuple[int, ...]) -> float | None:
    """The mean reward of the trials with these numbers, counted from 1; None for no trials."""
    rewards = [trial.reward for trial in trials_in(history)]
    return float(np.mean([rewards[number - 1] for number in trials])) if trials else None


def _chosen_after(history: Sequence[Iteration], tried: tuple[int, ...]) -> int:
    """The number of trials that were known before the policy was first `tried` (trials counted from 1); all if it was
    never tried.
    """
    ends = np.cumsum([sum(len(entry.trials) for entry in iteration) for iteration in history]).tolist()
    first = min(tried) if tried else ends[-1] + 1
    return max((end for end in ends if end < first), default=0)


def rows_of(particle: Particle) -> Samples:
    """The samples of a particle, as they are stored."""
    return tuple(as_row(sample) for sample in particle.samples)
