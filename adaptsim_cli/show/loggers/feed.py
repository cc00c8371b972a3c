"""The values of a session for a logger: reward, parameters, verdict and pictures, as soon as a trial or iteration is
stored.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.advice import check_first, in_words
from adaptsim_cli.session.folders import FILM
from adaptsim_cli.session.history import played_of, results_of
from adaptsim_cli.session.live_trial import PlannedTrial, TrackedTrial
from adaptsim_cli.session.records import MotionRecord, ResultRecord, TrialRecord
from adaptsim_cli.session.running import OpenView
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import SessionParts
from adaptsim_cli.session.watching import AllOf, PosteriorSource, Watcher
from adaptsim_cli.show.loggers import LOGGERS, SessionLogger
from adaptsim_cli.storage import durable


def with_loggers(names: Sequence[str], folder: Path, inner: OpenView) -> OpenView:
    """A view besides `inner` that keeps the session in each logger, below `folder`. Raises UsageError, ExtraMissing."""
    openers = {name: LOGGERS.get(name) for name in dict.fromkeys(names)}

    @contextmanager
    def open_view(screen: Screen, store: SessionStore, parts: SessionParts) -> Iterator[Watcher]:
        with ExitStack() as stack:
            watchers = [stack.enter_context(inner(screen, store, parts))]
            for name, opener in openers.items():
                place = _emptied(folder / name / store.facts.name)
                logger = opener(place, store.facts.name, store.facts.named())
                stack.callback(logger.close)
                command = f"; open it with `{logger.opened_by}`" if logger.opened_by else ""
                screen.plain(f"Log for {name}: {place}{command}")
                watchers.append(Feed(name, logger, screen, store))
            yield AllOf(*watchers)

    return open_view


def logged_again(name: str, folder: Path, store: SessionStore) -> Path:
    """Keep a stored session in a logger, below `folder`, and return its place. Raises UsageError, ExtraMissing."""
    opener = LOGGERS.get(name)
    place = _emptied(folder / name / store.facts.name)
    logger = opener(place, store.facts.name, store.facts.named())
    try:
        keep_new(store, logger, set())
    finally:
        logger.close()
    return place


class Feed:
    """`Watcher` that gives a logger the new values. A logger that fails is not used any more, and the session
    continues.
    """

    def __init__(self, name: str, logger: SessionLogger, screen: Screen, store: SessionStore) -> None:
        """The values that the session already has are logged at once, because each command begins a new log."""
        self._name, self._screen = name, screen
        self._logger: SessionLogger | None = logger
        self._kept: set[str] = set()
        self._keep(store)

    def proposed(self, trial: MotionRecord, planned: PlannedTrial) -> None:
        """See `Watcher`: a trial counts once it is stored."""

    def tracked(self, record: TrialRecord, tracked_trial: TrackedTrial) -> None:
        """See `Watcher`: a trial counts once it is stored."""

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """See `Watcher`."""
        self._keep(store)

    def reported(self, path: Path) -> None:
        """See `Watcher`. A logger gets no report."""

    def _keep(self, store: SessionStore) -> None:
        if self._logger is None:
            return
        try:
            keep_new(store, self._logger, self._kept)
        except Exception as error:  # noqa: BLE001 - whatever a foreign package raises, the session goes on
            self._logger = None
            self._screen.note(f"The log for {self._name} ends here, and the session goes on: {error}")


def keep_new(store: SessionStore, logger: SessionLogger, keys: set[str]) -> None:
    """Give a logger each trial and result with a key outside of `keys`, and add that key. Raises SessionError."""
    last = 0
    for trial in played_of(store):
        last = trial.trial
        if (key := f"trial-{trial.trial}-{trial.attempt}") not in keys:
            logger.values(trial.trial, _of_trial(trial))
            logger.words(trial.trial, "outcome", trial.outcome_words)
            folder = store.trial_folder(*trial.position)
            named = [(moment.label, moment.file) for moment in trial.moments] + [("film", FILM)]
            for name, file in named:
                if (folder / file).is_file() and file.endswith(".jpg"):
                    logger.picture(trial.trial, name, (folder / file).read_bytes())
            keys.add(key)
    for result in results_of(store):
        if (key := f"result-{result.iteration}") not in keys:
            step = min(last, store.facts.layout.numbers(result.iteration - 1).stop - 1)
            logger.values(step, _of_result(store, result))
            logger.words(step, "verdict", _verdict(store, result))
            keys.add(key)


def _of_trial(trial: TrialRecord) -> dict[str, float]:
    """The numbers of a trial, without parameters and prediction while a person must not know which policy acted."""
    values = {"reward": trial.reward}
    groups = {"context": trial.context, "action": trial.action}
    if not trial.is_blind:
        values["predicted_reward"] = trial.predicted_reward
        groups["parameter"] = trial.parameters
    return values | {f"{group}/{name}": value for group, named in groups.items() for name, value in named.items()}


def _of_result(store: SessionStore, result: ResultRecord) -> dict[str, float]:
    low, high = result.best.ci95
    values = {
        "iteration/number": float(result.iteration),
        "iteration/mean_reward": float(np.mean([trial.reward for trial in store.trials(result.iteration - 1)])),
        "best/reward": result.best.mean_reward,
        "best/low": low,
        "best/high": high,
    }
    return values | {f"best/{name}": value for name, value in result.best.params.items()}


def _verdict(store: SessionStore, result: ResultRecord) -> str:
    facts = store.facts
    first = check_first(facts.task, facts.hw, facts.calibration)
    return in_words(result.verdict, facts.object_name, facts.recorded, first)


def _emptied(folder: Path) -> Path:
    """An empty folder in place of an earlier log of the same session."""
    shutil.rmtree(folder, ignore_errors=True)
    durable.make_folder(folder)
    return folder
