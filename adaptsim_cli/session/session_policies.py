"""Policies that a session trains: for each particle that is far from everything in the library of Phase 1."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli.errors import SessionError
from adaptsim_cli.session.history import particles_of, results_of
from adaptsim_cli.session.store import SessionStore

if TYPE_CHECKING:
    from adaptsim_cli.screen.console import Screen
    from hw.types import Array
    from sim.adaptation.checkpoint import Checkpoint

FOLDER = "policies"


def with_session_policies(checkpoint: Checkpoint, session: Path, workers: int, screen: Screen | None) -> Checkpoint:
    """The checkpoint with the policies of the session in the folder `session`; the missing ones are trained.

    Without a `screen` nothing is trained. For a task without `train_in_session` it is the checkpoint itself. Raises
    TaskError if a training fails.
    """
    from sim.rollouts.executors import simulating_executor
    from sim.solvers.candidates import ListedActionSolver
    from sim.solvers.library import grown, name_for, trained_within
    from sim.tasks.library import PolicyLibrary, library_of
    from sim.tasks.members import Member

    solver, task = checkpoint.solver, checkpoint.solver.task
    training, library = task.training, library_of(task)
    if training is None or library is None or not training.train_in_session:
        return checkpoint
    assert isinstance(solver, ListedActionSolver)
    added = list[Member]()
    for mean in _means(session):
        nearest = PolicyLibrary((*library.members, *added))
        if nearest.distance(task, mean) <= training.distance:
            continue
        folder = session / FOLDER / name_for(mean)
        if screen is None:
            member = trained_within(task, mean, folder, 0.0, lambda s: None) if folder.exists() else None
        else:
            limit_s, stage = training.time_limit_s, f"policy {name_for(mean)}, at most {training.time_limit_s:g} s"
            with screen.progress() as progress:
                member = trained_within(task, mean, folder, limit_s, _share_of_limit(progress, stage, limit_s))
            if member is None:
                screen.plain(
                    f"The training of a policy took longer than its limit of {limit_s:g} s and was stopped; the "
                    "nearest policy of the library is used instead."
                )
        if member is not None:
            added.append(member)
    if not added:
        return checkpoint
    with simulating_executor(workers) as crew:
        more = grown(solver, added, session / FOLDER, crew, lambda done, total: None)
    return replace(checkpoint, solver=more)


def trained_policies(checkpoint: Checkpoint, session: Path, workers: int, screen: Screen) -> bool:
    """Train the missing policies of a session. Returns whether one is new to `with_session_policies`.

    Raises TaskError if a training fails.
    """
    before = {path.parent for path in (session / FOLDER).glob("*/policy.toml")}
    with_session_policies(checkpoint, session, workers, screen)
    return {path.parent for path in (session / FOLDER).glob("*/policy.toml")} != before


def _share_of_limit(progress: Callable[[str, int, int], None], stage: str, limit_s: float) -> Callable[[float], None]:
    """Shows the seconds of a training as a part of its limit."""
    return lambda seconds: progress(stage, round(seconds), max(1, round(limit_s)))


def _means(session: Path) -> Iterator[Array]:
    """The places of all particles of the session but the first ones, in their order."""
    try:
        store = SessionStore.open(session.parent, session.name)
        for iteration in range(1, len(results_of(store)) + 1):
            yield from (particle.mean for particle in particles_of(store, iteration))
    except SessionError:
        return
