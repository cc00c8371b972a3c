"""The interface to watchers: views of a running session besides the terminal."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.log import CommandLog
from adaptsim_cli.session.live_trial import PlannedTrial, TrackedTrial
from adaptsim_cli.session.records import MotionRecord, TrialRecord
from adaptsim_cli.session.store import SessionStore
from sim.adaptation.posterior import Posterior

PosteriorSource = Callable[[], Posterior | None]
"""Computes the belief about the true parameters on request; None if the method has none."""


class Watcher(Protocol):
    """A view of a session. Each call returns at once, and never raises because it cannot show something."""

    def proposed(self, trial: MotionRecord, planned: PlannedTrial) -> None:
        """A trial is planned; the operator is asked next."""

    def tracked(self, record: TrialRecord, tracked_trial: TrackedTrial) -> None:
        """A trial is tracked; the operator reviews it next."""

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """A trial or a result was stored."""

    def reported(self, path: Path) -> None:
        """The report of the session was drawn."""


class AllOf:
    """`Watcher` that forwards to several, or to none."""

    def __init__(self, *watchers: Watcher) -> None:
        self._watchers = watchers

    def proposed(self, trial: MotionRecord, planned: PlannedTrial) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.proposed(trial, planned)

    def tracked(self, record: TrialRecord, tracked_trial: TrackedTrial) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.tracked(record, tracked_trial)

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.changed(store, posterior)

    def reported(self, path: Path) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.reported(path)


BLIND = {"role", "parameters", "predicted_reward", "predicted_low", "predicted_high"}
"""Fields of a trial that would say whose policy acts; the log may be read while a session runs."""


class SessionLog(CommandLog):
    """The log in a session's folder, which is a `Watcher` too."""

    def proposed(self, trial: MotionRecord, planned: PlannedTrial) -> None:
        """See `Watcher`."""
        hidden = BLIND if trial.is_blind else set()
        self.write("planned", planned.summary, **trial.model_dump(mode="json", exclude_defaults=True, exclude=hidden))

    def tracked(self, record: TrialRecord, tracked_trial: TrackedTrial) -> None:
        """See `Watcher`."""
        self.write("tracked", outcome=record.outcome.value, reward=record.reward, flags=list(record.track.flags))

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """See `Watcher`."""
        existing = store.existing()
        self.write("stored", trials=len(existing.completed), iterations=len(existing.results))

    def reported(self, path: Path) -> None:
        """See `Watcher`."""
        self.write("reported", path.name)


@contextmanager
def logged(store: SessionStore, screen: Screen, versions: Mapping[str, str]) -> Iterator[SessionLog]:
    """Log one command of a session from here to its end, however it ends."""
    log = SessionLog(store.folder, screen)
    screen.add_listener(log)
    log.write("begun", versions=dict(versions), python=platform.python_version(), process=os.getpid())
    try:
        yield log
    except (Exception, KeyboardInterrupt) as error:
        log.write("ended", str(error) or "interrupted", error=type(error).__name__)
        raise
    log.write("ended")
