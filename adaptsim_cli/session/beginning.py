"""A new session: its facts, and its first particles."""

from __future__ import annotations

import secrets
from dataclasses import asdict
from pathlib import Path

from adaptsim_cli.config import Config
from adaptsim_cli.session.records import (
    FORMAT,
    WITH_CONTROL,
    Draw,
    SessionFacts,
    SessionStart,
    as_records,
    generator,
    now,
)
from adaptsim_cli.session.results import rows_of
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import SessionParts

NO_CONSENT = "each motion of a real robot is confirmed at a terminal, also with --yes: run in a terminal"


def begin(root: Path, name: str, config: Config, parts: SessionParts) -> SessionStore:
    """A new session with its first particles. Raises UsageError, SessionError, DiskFull."""
    particles = parts.adaptation.start(config.particles, generator(config.seed, Draw.START))
    start = SessionStart(particles=tuple(rows_of(p) for p in particles))
    return SessionStore.create(root, facts_for(name, config, parts), start)


def facts_for(name: str, config: Config, parts: SessionParts, **changes: str | int) -> SessionFacts:
    """The facts of a new session; `changes` are fields that do not come from the settings."""
    facts = SessionFacts(
        format=WITH_CONTROL if config.control else FORMAT,
        name=name,
        task=parts.task.name,
        hw=config.hw,
        world=config.lab_world,
        recorded=config.recorded,
        held_out=config.held_out if config.recorded else 0.0,
        start_from=config.start_from,
        seed=config.seed,
        method=config.method,
        control=config.control,
        pairs=config.pairs,
        control_seed=config.seed if config.is_simulated or not config.control else secrets.randbits(31),
        solver=config.solver,
        object=config.object,
        particles=config.particles,
        trials=parts.task.adaptation.trials_per_iteration,
        created=now(),
        title=parts.task.title,
        object_name=parts.task.object_name,
        task_file="" if parts.task.file is None else parts.task.file.path,
        task_sha256="" if parts.task.file is None else parts.task.file.sha256,
        parameters=as_records(parts.task.parameters),
        context=as_records(parts.task.context),
        action=as_records(parts.task.action),
        **asdict(parts.provenance),
        curves=dict(zip(parts.task.observation.curves, parts.task.observation.columns, strict=False)),
    )
    return facts.model_copy(update=changes)
