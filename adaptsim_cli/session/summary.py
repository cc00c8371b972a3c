"""A session as the commands print it: one iteration, one line in a list, everything."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen.outputs.sessions import (
    Damaged,
    SessionRow,
    SessionShown,
    ShownRejection,
    ShownResult,
    ShownWaiting,
)
from adaptsim_cli.screen.outputs.trials import IterationOutput, ParticleShown, PlayedTrial, named
from adaptsim_cli.session.about import about
from adaptsim_cli.session.folders import size_bytes
from adaptsim_cli.session.history import particles_of, played_of, results_of, trials_of
from adaptsim_cli.session.records import ResultRecord, Samples, TrialRecord
from adaptsim_cli.session.store import SessionStore
from sim.adaptation.method import Particle


def summary(store: SessionStore, result: ResultRecord) -> IterationOutput:
    """One iteration, as `run-iteration --json` prints it; parameters by name, in units. Raises SessionError."""
    facts, iteration = store.facts, result.iteration - 1
    names, trials = [d.name for d in facts.parameters], store.trials(iteration)
    particles = zip(particles_of(store, iteration), result.next_particles, strict=True)
    return IterationOutput(
        task=facts.task,
        session=facts.name,
        iteration=result.iteration,
        hw=facts.hw,
        world=facts.world,
        seed=facts.seed,
        units=facts.units,
        particles=[
            _particle(names, particle, [t for t in trials if t.particle == index + 1], then)
            for index, (particle, then) in enumerate(particles)
        ],
        best=result.best,
        verdict=result.verdict,
        outlook=result.outlook,
        suspicion=result.suspicion,
        control=result.control,
        timing_s={key: round(value, 3) for key, value in result.timing_s.items()},
    )


def _particle(names: Sequence[str], now: Particle, trials: Sequence[TrialRecord], then: Samples) -> ParticleShown:
    return ParticleShown(
        params=named(names, now.mean),
        trials=[trial.view(PlayedTrial).model_copy(update={"timing_s": None}) for trial in trials],
        mean_reward=float(np.mean([trial.reward for trial in trials])),
        next_params=named(names, np.mean(then, axis=0)),
    )


def overview(store: SessionStore) -> SessionRow:
    """One session in one line. Raises SessionError."""
    facts, results, remarks = store.facts, results_of(store), about(store.folder)
    rewards = [trial.reward for trial in trials_of(store)]
    return SessionRow(
        session=facts.name,
        task=facts.task,
        hw=facts.hw,
        world=facts.world,
        method=facts.method,
        seed=facts.seed,
        created=facts.created,
        iterations=len(results),
        trials=len(rewards),
        mean_reward=float(np.mean(rewards)) if rewards else None,
        verdict=results[-1].verdict if results else None,
        size_bytes=size_bytes(store.folder),
        note=remarks.note,
        begun_as=store.begun_as,
    )


def overview_or_damage(root: Path, name: str) -> SessionRow | Damaged:
    """One session in one line; a damaged one with its error, so that the list still shows the others."""
    try:
        return overview(SessionStore.open(root, name))
    except SessionError as error:
        return Damaged(session=name, error=str(error))


def details(store: SessionStore) -> SessionShown:
    """One session with all its counting trials and results. Raises SessionError."""
    facts, existing = store.facts, store.existing()
    shown = SessionShown(
        facts=facts.model_dump(mode="json"),
        folder=str(store.folder),
        units=facts.units,
        trials=[trial.view(PlayedTrial) for trial in played_of(store)],
        rejected=[
            ShownRejection(trial=one.key.number, attempt=one.key.attempt + 1, at=one.note.at, reason=one.note.text)
            for one in store.rejections()
        ],
        waiting=[
            ShownWaiting(trial=key.number, attempt=key.attempt + 1)
            for key in sorted(existing.recorded - existing.rejected, key=lambda key: (key.number, key.attempt))
        ],
        results=[result.view(ShownResult) for result in results_of(store)],
        newer_keys=(),
    )
    return shown.model_copy(update={"newer_keys": store.additions()})  # of all records that were read above
