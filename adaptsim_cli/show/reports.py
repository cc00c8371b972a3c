"""Writes the pages of sessions, each with the judgement of the checkpoint that it was begun with."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli.config import DIRECT
from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen.outputs.learning import Revealed
from adaptsim_cli.session.folders import names
from adaptsim_cli.session.hindsight import Hindsight
from adaptsim_cli.session.history import results_of, trials_of
from adaptsim_cli.session.judgement import Judgement
from adaptsim_cli.session.records import ROLLOUT
from adaptsim_cli.session.store import RESULT, TRIAL, SessionStore
from adaptsim_cli.show import page, truth_view
from adaptsim_cli.show.truth import revealed
from sim.errors import RecordingsRefused, SimError

if TYPE_CHECKING:
    from rich.console import RenderableType


@dataclass
class Reports:
    """Writes the pages of sessions; the checkpoint of each is loaded once."""

    _hindsights: dict[str, Hindsight] = field(default_factory=dict)

    def draw(self, store: SessionStore, out: Path | None = None) -> Path:
        """Write the page of a session and return its path. Raises SessionError.

        If its checkpoint is gone or has no parts for inference, the page says so.
        """
        judgement = self.judgement(store)
        return page.write(store, out, judgement, measured_udr(store), confirmed(store), self.truth(store))

    def ending(self, store: SessionStore) -> RenderableType | None:
        """The last words of a session: truth, range and belief in a simulated world; None beside a real arm."""
        shown = self.truth(store)
        return None if shown is None else truth_view.table(shown)

    def truth(self, store: SessionStore) -> Revealed | None:
        """Truth, range and belief of a simulated session; None if there is none. Raises SessionError on damage."""
        key = _key(store)
        try:
            if key not in self._hindsights:
                self._hindsights[key] = Hindsight.of(store)
        except SimError:
            return None
        hindsight = self._hindsights[key]
        return revealed(store, hindsight.checkpoint, lambda: hindsight.posterior(store))

    def judgement(self, store: SessionStore) -> Judgement | str:
        """The judgement of a session, or the reason why there is none. Raises SessionError on damage."""
        sha256 = _key(store)
        try:
            if sha256 not in self._hindsights:
                self._hindsights[sha256] = Hindsight.of(store)
        except SimError as error:
            return str(error)
        try:
            return (
                self._hindsights[sha256].evaluate(store) if store.existing().completed else "No trial is complete yet."
            )
        except RecordingsRefused as error:
            return str(error)


def _key(store: SessionStore) -> str:
    """The same for sessions with the same checkpoint, prior and recordings."""
    facts = store.facts
    if facts.solver == DIRECT:  # it keeps rollouts of its own, more with every trial
        return f"{facts.name} {len(store.existing().completed)} {len(results_of(store))}"
    return facts.checkpoint_sha256 + facts.start_from_sha256 + (facts.name if facts.recorded else "")


def confirmed(store: SessionStore) -> tuple[float, ...]:
    """Rewards of rollouts of the session's present best policy, since its newest result.

    Older ones do not count; unreadable ones are skipped.
    """
    results = [file.stat().st_mtime_ns for file in store.folder.glob(f"iteration-*/result-*/{RESULT}")]
    if not results:
        return ()
    values, root = list[float](), store.folder.parent
    for name in names(root):
        with suppress(SessionError):
            other = SessionStore.open(root, name)
            if (other.facts.method, other.facts.policy_of) == (ROLLOUT, store.facts.name):
                files = ((other.trial_folder(*trial.position) / TRIAL, trial.reward) for trial in trials_of(other))
                values += [reward for file, reward in files if file.stat().st_mtime_ns >= max(results)]
    return tuple(values)


def measured_udr(store: SessionStore) -> page.Reference | None:
    """The UDR session with the most trials, of the same task in the same world or with the same real arm; None if there
    is none.

    Unreadable sessions are skipped.
    """
    facts, references = store.facts, list[page.Reference]()
    for name in names(store.folder.parent):
        with suppress(SessionError):
            other = SessionStore.open(store.folder.parent, name)
            o = other.facts
            same = (o.task, o.hw, o.world_sha256, o.object) == (facts.task, facts.hw, facts.world_sha256, facts.object)
            if o.method == "udr" and same and name != facts.name:
                rewards = tuple(trial.reward for trial in trials_of(other))
                references += [page.Reference(name, rewards)] if rewards else []
    return max(references, key=lambda reference: len(reference.rewards), default=None)
