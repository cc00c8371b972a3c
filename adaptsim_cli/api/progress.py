"""One progress bar for a run from Python, on a terminal or as one output of a notebook. Elsewhere nothing is shown."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.live_trial import PlannedTrial, TrackedTrial
from adaptsim_cli.session.records import MotionRecord, TrialRecord
from adaptsim_cli.session.running import OpenView
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import SessionParts
from adaptsim_cli.session.watching import PosteriorSource, Watcher

Bar = Callable[[int, str], None]
"""(trials completed, the present step)."""


def silent() -> Screen:
    """A screen that shows nothing, also in a notebook."""
    return Screen(console=Console(file=io.StringIO(), force_jupyter=False))


def with_bar(iterations: int) -> OpenView:
    """Shows the progress of the next `iterations` of a session."""

    @contextmanager
    def open_view(screen: Screen, store: SessionStore, parts: SessionParts) -> Iterator[Watcher]:
        layout, done = store.facts.layout, len(store.existing().completed)
        present = len([i for i in range(store.iterations()) if store.result(i) is not None])
        total = layout.numbers(present + iterations - 1).stop - 1
        with one_bar(store.facts.name, done, total) as bar:
            view = _BarView(bar, done)
            screen.add_listener(view)
            yield view

    return open_view


class _BarView:
    """`Watcher` and `Listener` that move a bar."""

    def __init__(self, bar: Bar, done: int) -> None:
        self._bar, self._done = bar, done

    def doing(self, what: str, stage: str) -> None:
        """See `Listener`."""
        self._bar(self._done, what)

    def did(self, what: str, stage: str, took_s: float) -> None:
        """See `Listener`: the next step replaces it."""

    def asking(self, question: str) -> None:
        """See `Listener`: nobody is asked."""

    def answered(self, question: str, answer: str, took_s: float) -> None:
        """See `Listener`: nobody is asked."""

    def noted(self, text: str) -> None:
        """See `Listener`: the log of the session keeps it."""

    def proposed(self, trial: MotionRecord, planned: PlannedTrial) -> None:
        """See `Watcher`."""

    def tracked(self, record: TrialRecord, tracked_trial: TrackedTrial) -> None:
        """See `Watcher`."""

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """See `Watcher`."""
        self._done = len(store.existing().completed)
        self._bar(self._done, "")

    def reported(self, path: object) -> None:
        """See `Watcher`."""


@contextmanager
def one_bar(name: str, done: int, total: int) -> Iterator[Bar]:
    """A progress bar for the session `name` with `total` trials, of which `done` are complete at the start."""
    if is_notebook():
        with _notebook_bar(name, done, total) as bar:
            yield bar
    elif sys.stderr.isatty():
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[step]}"),
        )
        with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
            row = bars.add_task(name, completed=done, total=total, step="")
            yield lambda count, step: bars.update(row, completed=count, step=step)
    else:
        yield lambda count, step: None


def is_notebook() -> bool:
    """Whether a kernel of Jupyter runs this program."""
    if "IPython" not in sys.modules:
        return False
    shell = sys.modules["IPython"].get_ipython()
    return shell is not None and getattr(shell, "kernel", None) is not None


@contextmanager
def _notebook_bar(name: str, done: int, total: int) -> Iterator[Bar]:
    from IPython.display import HTML, display

    began_s, last = time.monotonic(), done

    def shown(count: int, step: str) -> HTML:
        spent = f"{time.monotonic() - began_s:.0f} s"
        text = f"{name}: {count} of {total} trials, {step or spent}"
        return HTML(f'<progress value="{count}" max="{total}"></progress> {escape(text)}')

    handle = display(shown(done, "begins"), display_id=True)

    def update(count: int, step: str) -> None:
        nonlocal last
        last = count
        handle.update(shown(count, step))

    try:
        yield update
    finally:
        handle.update(shown(last, ""))
