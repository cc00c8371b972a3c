"""Joins a stored session with the checkpoint that it was begun with: what its trajectories say, seen from the end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli import config
from adaptsim_cli.errors import SessionError
from adaptsim_cli.report import page
from adaptsim_cli.report.hindsight import Judgement, Prediction
from adaptsim_cli.session.history import history_of, particles_of
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.store import SessionStore, names
from adaptsim_cli.wiring.checkpoints import own_checkpoints, task_of
from sim.errors import CheckpointError, SimError

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.adaptation.methods.belief import Belief
    from sim.adaptation.posterior import Posterior, Prospect
    from sim.solvers.solver import SolvedPolicy

LIKELY = 24
"""Trajectories of the posterior that are drawn of every trial."""


def checkpoint_of_session(store: SessionStore) -> Checkpoint:
    """The checkpoint that a stored session was begun with, found by the hash of its weights.

    Raises CheckpointError where none of the shipped ones, of the settings' and of the user's own is that one.
    """
    from sim.adaptation.checkpoint import load_checkpoint, read_card

    facts = store.facts
    task = task_of(replace(config.load().config, task=facts.task, object=facts.object))
    for folder in _folders(facts.task):
        try:
            if str(read_card(folder, task.name)["sha256"]) == facts.checkpoint_sha256:
                return load_checkpoint(task, str(folder))
        except (CheckpointError, KeyError):
            continue
    raise CheckpointError(
        f"session {facts.name!r} was begun with the checkpoint {facts.checkpoint} ({facts.checkpoint_sha256[:12]}), "
        "which is not here any more: name its folder with ADAPTSIM_CHECKPOINT"
    )


@dataclass(frozen=True, eq=False)
class Hindsight:
    """A checkpoint asked what the trajectories of its sessions say. It remembers what it worked out of each trial."""

    checkpoint: Checkpoint
    belief: Belief

    @classmethod
    def of(cls, store: SessionStore) -> Hindsight:
        """Raises CheckpointError where the session's checkpoint is gone, or holds nothing to infer with."""
        from sim.adaptation.methods.belief import create

        checkpoint = checkpoint_of_session(store)
        return cls(checkpoint, create(checkpoint.solver.task, checkpoint))

    def posterior(self, store: SessionStore, iterations: int | None = None) -> Posterior:
        """After so many iterations of a session; by default after all of its trials. Raises SessionError."""
        from sim.adaptation.posterior import posterior

        begun = store.iterations() if iterations is None else min(iterations, store.iterations())
        return posterior(self.belief, history_of(self.checkpoint.solver.task, store, begun - 1))

    def judge(self, store: SessionStore) -> Judgement:
        """All that a report shows of a session. Raises SessionError without trials."""
        from sim.adaptation.method import Particle
        from sim.adaptation.posterior import policies_of, policies_of_udr, prospect

        checkpoint, count = self.checkpoint, store.iterations()
        trials = [trial for i in range(count) for trial in store.trials(i)]
        if not trials:
            raise SessionError(f"session {store.facts.name} has no completed trial yet")
        results = [result for i in range(count) if (result := store.result(i)) is not None]
        posteriors = tuple(self.posterior(store, i) for i in range(trials[-1].iteration + 2))
        known = posteriors[-1]

        def expected(policies: Sequence[SolvedPolicy]) -> Prospect:
            return prospect(checkpoint, known, policies, np.random.default_rng(0))  # the same targets for all

        best = results[-1].best.params if results else {}
        mean = np.array([[best[name] for name in checkpoint.solver.task.parameters.names]]) if best else None
        return Judgement(
            posteriors=posteriors,
            predictions={trial.number: self._prediction(store, trial, known) for trial in trials},
            first=expected(policies_of(checkpoint, particles_of(store, 0))),
            adapted=None if mean is None else expected(policies_of(checkpoint, [Particle(mean)])),
            udr=expected(policies_of_udr(checkpoint)),
        )

    def _prediction(self, store: SessionStore, trial: TrialRecord, posterior: Posterior) -> Prediction:
        from sim.adaptation.posterior import predicted

        solver, context, action = self.checkpoint.solver, np.array(trial.context), np.array(trial.action)
        guess = particles_of(store, trial.iteration)[trial.particle].mean
        drawn = posterior.draw(LIKELY, np.random.default_rng(trial.number))
        states = predicted(solver, np.concatenate([guess[None], drawn]), context, action)
        seen = solver.task.observation
        return Prediction(seen.times_s, seen.columns, states[0], states[1:])


@dataclass
class Reports:
    """Writes the pages of sessions; the checkpoint of each is loaded once."""

    _known: dict[str, Hindsight] = field(default_factory=dict)

    def draw(self, store: SessionStore, out: Path | None = None) -> Path:
        """Write the page of a session and return its path. Raises SessionError.

        Where its checkpoint is gone or knows nothing to infer with, the page says so.
        """
        return page.write(store, out, self.judgement(store), measured_udr(store))

    def judgement(self, store: SessionStore) -> Judgement | str:
        """What the simulator makes of a session, or why it can say nothing. Raises SessionError on damage."""
        sha256 = store.facts.checkpoint_sha256
        try:
            if sha256 not in self._known:
                self._known[sha256] = Hindsight.of(store)
        except SimError as error:
            return str(error)
        return self._known[sha256].judge(store) if store.existing().completed else "No trial is complete yet."


def measured_udr(store: SessionStore) -> page.Reference | None:
    """The UDR session with the most trials of the same task in the same world, or with the same real arm; None: none.

    Sessions that cannot be read count as none.
    """
    facts, found = store.facts, list[page.Reference]()
    for name in names(store.folder.parent):
        with suppress(SessionError):
            other = SessionStore.open(store.folder.parent, name)
            o = other.facts
            same = (o.task, o.hw, o.world_sha256, o.object) == (facts.task, facts.hw, facts.world_sha256, facts.object)
            if o.method == "udr" and same and name != facts.name:
                rewards = tuple(t.reward for i in range(other.iterations()) for t in other.trials(i))
                found += [page.Reference(name, rewards)] if rewards else []
    return max(found, key=lambda reference: len(reference.rewards), default=None)


def _folders(task: str) -> Iterator[Path]:
    """Where the checkpoint of a session may lie: as the settings say, shipped, the user's own."""
    from sim.adaptation.checkpoint import SHIPPED

    if named := config.load().config.checkpoint:
        yield Path(named)
    yield from sorted((SHIPPED / task).glob("*")) if (SHIPPED / task).is_dir() else ()
    yield from own_checkpoints()
