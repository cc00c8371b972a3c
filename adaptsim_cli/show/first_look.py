"""Is this your table? The first trial of a robot of one's own, over the simulator's expectation of it.

Units, frames and columns of other people's code can be wrong although every value is in its range, for example degrees
instead of radians. A person sees it at the first trial.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from adaptsim_cli.config import is_own
from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.html import fill
from adaptsim_cli.screen.views import quantity
from adaptsim_cli.session.judgement import Prediction
from adaptsim_cli.session.live_trial import TrackedTrial
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.running import OpenView
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import SessionParts
from adaptsim_cli.session.watching import AllOf, Watcher
from adaptsim_cli.show import figures
from adaptsim_cli.storage import durable
from sim.adaptation.posterior import predicted
from sim.tasks.task import Expectations

PAGE = "first-trial.html"

DRAWN = 64
"""Number of parameter sets from the whole range of training, each with its predicted trajectory."""

MARGIN = 0.1
"""An end is outside if it lies this share of the task's observation range beyond all predicted ones, because place and
action of a real trial have errors too."""


@dataclass(frozen=True)
class ReportedEnd:
    """One quantity of the object's state at the last observed moment, beside its predicted range."""

    name: str
    unit: str
    reported: float
    low: float  # of the predicted ends
    high: float
    margin: float  # still plausible beyond them

    @property
    def is_outside(self) -> bool:
        """Whether no parameters of the training range lead near it."""
        return not self.low - self.margin <= self.reported <= self.high + self.margin

    @property
    def expected(self) -> str:
        """`0.61 m to 0.84 m`."""
        return f"{quantity(self.low, self.unit)} to {quantity(self.high, self.unit)}"

    @property
    def in_words(self) -> str:
        """`x 0.70 m (predicted 0.61 m to 0.84 m)`."""
        return f"{self.name} {quantity(self.reported, self.unit)} (predicted {self.expected})"


@dataclass(frozen=True)
class FirstLook:
    """A page about the first trial of a session: its trajectory over those that the simulator expects."""

    session: str
    trial: TrialRecord
    expected: Prediction
    curves: tuple[str, ...]
    ends: tuple[ReportedEnd, ...]

    @classmethod
    def of(cls, store: SessionStore, expectations: Expectations, record: TrialRecord) -> FirstLook:
        """Simulates the trial with parameters from everywhere in the range of training."""
        task = expectations.task
        sight = task.observation
        drawn = np.vstack([list(record.parameters.values()), task.parameters.sample(np.random.default_rng(0), DRAWN)])
        states = predicted(expectations, drawn, record.context_array, record.action_array)
        columns = [task.require_report().columns[column] for column in sight.columns]
        last = np.array(record.track.state)[-1, list(sight.columns)]
        low, high, margin = states[:, -1].min(axis=0), states[:, -1].max(axis=0), MARGIN * (sight.high - sight.low)
        ends = tuple(
            ReportedEnd(name, unit.rstrip("]"), *map(float, numbers))
            for (name, _, unit), *numbers in zip(
                (column.partition(" [") for column in columns), last, low, high, margin, strict=True
            )
        )
        expected = Prediction(sight.times_s, sight.columns, states[0], states[1:])
        return cls(store.facts.name, record, expected, tuple(store.facts.curves), ends)

    @property
    def setting(self) -> str:
        """Where its trials are made: "table" for a task with a path on the table, else "robot"."""
        return "robot" if self.curves else "table"

    @property
    def question(self) -> str:
        """The question to the person."""
        return f"Is this your {self.setting}?"

    @property
    def in_words(self) -> str:
        """The question to the person, with the numbers that answer it."""
        ends = "; ".join(end.in_words for end in self.ends)
        question = f"{self.question} At the end of the first trial: {ends}"
        outside = ", ".join(end.name for end in self.ends if end.is_outside)
        return f"{question}.{f' Outside in {outside}: check units, frame and columns.' if outside else ''}"

    def write(self, folder: Path) -> Path:
        """The page, in the session's folder. Raises SessionError."""
        path = folder / PAGE
        html = fill(
            "show/first_look.html.j2",
            look=self,
            picture=figures.prediction(self.trial, self.expected, self.curves),
            quantity=quantity,
        )
        durable.replace_file(path, html.encode())
        return path


class _Looking(AllOf):
    """`Watcher` that shows the first trial before the operator reviews it."""

    def __init__(self, screen: Screen, store: SessionStore, expectations: Expectations, *others: Watcher) -> None:
        super().__init__(*others)
        self._screen, self._store, self._expectations = screen, store, expectations

    def tracked(self, record: TrialRecord, tracked_trial: TrackedTrial) -> None:
        """See `Watcher`."""
        super().tracked(record, tracked_trial)
        if record.trial > 1:
            return
        try:
            with self._screen.busy("Drawing the first trial over the predicted ones", "drawing"):
                look = FirstLook.of(self._store, self._expectations, record)
                path = look.write(self._store.folder)
        except SessionError as error:
            self._screen.note(f"The first trial is not drawn over the predicted ones: {error}")
            return
        self._screen.note(look.in_words)
        self._screen.file("  Its trajectory over the predicted ones", path)


def with_first_look(open_view: OpenView) -> OpenView:
    """The same view; with a robot of one's own the first trial is shown over the predicted ones."""

    @contextmanager
    def view(screen: Screen, store: SessionStore, parts: SessionParts) -> Iterator[Watcher]:
        with open_view(screen, store, parts) as watcher:
            yield _Looking(screen, store, parts.adaptation.expectations, watcher) if is_own(store.facts.hw) else watcher

    return view
