"""Evaluates the trajectories of a stored session again, with the checkpoint that it was begun with."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli.errors import SessionError
from adaptsim_cli.report import page
from adaptsim_cli.report.figures import Judgement, Prediction
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.store import SessionStore, history_of, names, particles_of
from adaptsim_cli.wiring.best import policy_of_session
from adaptsim_cli.wiring.checkpoints import checkpoint_of_session
from sim.errors import SimError

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.adaptation.methods.belief import Belief
    from sim.adaptation.posterior import Posterior, Prospect
    from sim.solvers.solver import SolvedPolicy

LIKELY = 24
"""Number of trajectories drawn from the posterior for each trial."""


@dataclass(frozen=True, eq=False)
class Hindsight:
    """A checkpoint that evaluates the trajectories of its sessions. It caches the results of each trial."""

    checkpoint: Checkpoint
    belief: Belief

    @classmethod
    def of(cls, store: SessionStore) -> Hindsight:
        """Raises CheckpointError if the session's checkpoint is gone, or has no parts for inference."""
        from sim.adaptation.methods.belief import create

        checkpoint = checkpoint_of_session(store)
        return cls(checkpoint, create(checkpoint.solver.task, checkpoint))

    def posterior(self, store: SessionStore, iterations: int | None = None) -> Posterior:
        """The posterior after `iterations` iterations; by default after all trials. Raises SessionError."""
        from sim.adaptation.posterior import posterior

        begun = store.iterations() if iterations is None else min(iterations, store.iterations())
        return posterior(self.belief, history_of(self.checkpoint.solver.task, store, begun - 1))

    def judge(self, store: SessionStore) -> Judgement:
        """The judgement that a report shows. Raises SessionError without trials."""
        from sim.adaptation.posterior import policies_of, policies_of_udr, prospect

        checkpoint, count = self.checkpoint, store.iterations()
        trials = [trial for i in range(count) for trial in store.trials(i)]
        if not trials:
            raise SessionError(f"session {store.facts.name} has no completed trial yet")
        done = any(store.result(i) is not None for i in range(count))
        posteriors = tuple(self.posterior(store, i) for i in range(trials[-1].iteration + 1))
        known = posteriors[-1]

        def expected(policies: Sequence[SolvedPolicy]) -> Prospect:
            return prospect(checkpoint, known, policies, np.random.default_rng(0))  # the same targets for all

        return Judgement(
            posteriors=posteriors,
            predictions={trial.trial: self._prediction(trial, known) for trial in trials},
            first=expected(policies_of(checkpoint, particles_of(store, 0))),
            adapted=expected([policy_of_session(store, checkpoint)]) if done else None,
            udr=expected(policies_of_udr(checkpoint)),
        )

    def _prediction(self, trial: TrialRecord, posterior: Posterior) -> Prediction:
        from sim.adaptation.posterior import predicted

        solver, context, action = self.checkpoint.solver, trial.context_array, trial.action_array
        guess = np.array(list(trial.parameters.values()))
        drawn = posterior.draw(LIKELY, np.random.default_rng(trial.trial))
        states = predicted(solver, np.concatenate([guess[None], drawn]), context, action)
        seen = solver.task.observation
        return Prediction(seen.times_s, seen.columns, states[0], states[1:])


@dataclass
class Reports:
    """Writes the pages of sessions; the checkpoint of each is loaded once."""

    _known: dict[str, Hindsight] = field(default_factory=dict)

    def draw(self, store: SessionStore, out: Path | None = None) -> Path:
        """Write the page of a session and return its path. Raises SessionError.

        If its checkpoint is gone or has no parts for inference, the page says so.
        """
        return page.write(store, out, self.judgement(store), measured_udr(store))

    def judgement(self, store: SessionStore) -> Judgement | str:
        """The judgement of a session, or the reason why there is none. Raises SessionError on damage."""
        sha256 = store.facts.checkpoint_sha256
        try:
            if sha256 not in self._known:
                self._known[sha256] = Hindsight.of(store)
        except SimError as error:
            return str(error)
        return self._known[sha256].judge(store) if store.existing().completed else "No trial is complete yet."


def measured_udr(store: SessionStore) -> page.Reference | None:
    """The UDR session with the most trials, of the same task in the same world or with the same real arm; None: none.

    Unreadable sessions are skipped.
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
