"""The interface to watchers: views of a running session besides the terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from adaptsim_cli.session.operator import Proposal
from adaptsim_cli.session.records import Facts, TrialRecord
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import MotionPreview, TrackedTrial
from sim.adaptation.posterior import Posterior

PosteriorSource = Callable[[], Posterior | None]
"""Computes the belief about the true parameters on request; None if the method has none."""


@dataclass(frozen=True)
class RunHeader:
    """The session or rollout that a watcher shows."""

    name: str  # of the session or rollout
    what: str  # one line: the session and its method, or the rollout
    hw: str
    particles: int = 0  # 0: a single rollout

    @classmethod
    def session(cls, facts: Facts) -> RunHeader:
        """A session."""
        return cls(facts.name, f"session {facts.name}, method {facts.method}", facts.hw, facts.particles)


class Watcher(Protocol):
    """A view of a session. Each call returns at once, and never raises because it cannot show something."""

    def proposed(self, made: Proposal, preview: MotionPreview | None) -> None:
        """A trial is planned; the operator is asked next."""
        ...

    def tracked(self, record: TrialRecord, seen: TrackedTrial) -> None:
        """A trial is tracked; the operator reviews it next."""
        ...

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """A trial or a result was stored."""
        ...

    def reported(self, path: Path) -> None:
        """The report of the session was drawn."""
        ...


class Unwatched:
    """`Watcher` that shows nothing."""

    def proposed(self, made: Proposal, preview: MotionPreview | None) -> None:
        """See `Watcher`."""

    def tracked(self, record: TrialRecord, seen: TrackedTrial) -> None:
        """See `Watcher`."""

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """See `Watcher`."""

    def reported(self, path: Path) -> None:
        """See `Watcher`."""


class AllOf:
    """`Watcher` that forwards to several."""

    def __init__(self, watchers: Sequence[Watcher]) -> None:
        self._watchers = tuple(watchers)

    def proposed(self, made: Proposal, preview: MotionPreview | None) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.proposed(made, preview)

    def tracked(self, record: TrialRecord, seen: TrackedTrial) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.tracked(record, seen)

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.changed(store, posterior)

    def reported(self, path: Path) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.reported(path)
