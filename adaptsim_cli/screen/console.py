"""Every print, prompt, table and progress bar.

Data go to stdout; with `--json` everything that a person reads goes to stderr. Rich obeys NO_COLOR and TERM=dumb and
measures the terminal.
"""

from __future__ import annotations

import json
import sys
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.text import Text

from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen import loading, views
from adaptsim_cli.screen.checks import Readiness


class Screen:
    """The terminal, or what stands for it."""

    def __init__(self, *, as_json: bool = False, console: Console | None = None) -> None:
        loading.clear()
        self._console = console or Console(stderr=as_json, highlight=False, markup=False)
        self._live = self._console.is_terminal and not self._console.is_dumb_terminal

    @property
    def width(self) -> int:
        """Columns of the terminal."""
        return self._console.width

    def show(self, what: RenderableType) -> None:
        """Print text, a table or any other renderable of rich."""
        self._console.print(what)

    def plain(self, text: str) -> None:
        """One line as it is, whatever the width: paths can be copied."""
        self._console.print(Text(text), soft_wrap=True)

    def note(self, text: str) -> None:
        """Print a line that should be noticed."""
        self.show(Text(text, style="yellow"))

    def data(self, value: Any) -> None:
        """One JSON object on one line of stdout."""
        sys.stdout.write(json.dumps(value, allow_nan=False) + "\n")
        sys.stdout.flush()

    def ask(self, question: str) -> str:
        """One line of answer, lower case and stripped. Raises StoppedByOperator at the end of input."""
        return self.ask_text(question).lower()

    def ask_text(self, question: str) -> str:
        """One line of answer as it was typed, stripped. Raises StoppedByOperator at the end of input."""
        if sys.stdin.isatty():  # what was typed before the question is no answer to it: Enter may start a motion
            termios.tcflush(sys.stdin, termios.TCIFLUSH)
        self._console.print(Text(question, style="bold"), end=" ")
        answer = sys.stdin.readline()
        if not answer:
            raise StoppedByOperator("the input ended; everything completed is stored")
        return answer.strip()

    @contextmanager
    def busy(self, what: str) -> Iterator[None]:
        """A spinner on a terminal, one line elsewhere."""
        if self._live:
            with self._console.status(what):
                yield
        else:
            self.show(Text(f"  {what}", style="dim"))
            yield

    @contextmanager
    def progress(self) -> Iterator[Callable[[str, int, int], None]]:
        """Yields `update(stage, done, total)`: a bar a stage on a terminal, a line every tenth elsewhere."""
        if self._live:
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            with Progress(*columns, console=self._console) as bars:
                rows: dict[str, TaskID] = {}

                def draw(stage: str, done: int, total: int) -> None:
                    if stage not in rows:
                        rows[stage] = bars.add_task(stage, total=total)
                    bars.update(rows[stage], completed=done, total=total)

                yield draw
        else:
            said: set[tuple[str, int]] = set()
            began: dict[str, tuple[float, int]] = {}  # when a stage was first heard of, and how far it was

            def say(stage: str, done: int, total: int) -> None:
                tenth = 10 * done // max(total, 1)
                since, before = began.setdefault(stage, (time.monotonic(), done))
                if (stage, tenth) not in said:
                    said.add((stage, tenth))
                    left = _left(time.monotonic() - since, done - before, total - done)
                    self.show(Text(f"  {stage}: {10 * tenth} % ({done} of {total}){left}"))

            yield say

    def checks(self, found: Sequence[Readiness]) -> None:
        """Print which checks passed, and the remedy for each that did not."""
        self.show(views.checks(found))


def _left(spent_s: float, done: int, missing: int) -> str:
    """How long what is missing takes at the speed so far; empty while nobody can know, and under ten seconds."""
    seconds = spent_s * missing / done if done else 0.0
    if seconds < 10.0:
        return ""
    return f", {seconds / 60.0:.0f} min left" if seconds >= 90.0 else f", {seconds:.0f} s left"


def error(message: str) -> None:
    """One clear message on stderr, on a line of its own, and unbroken so that commands in it can be copied."""
    loading.clear()
    console = Console(stderr=True, highlight=False, markup=False)
    if console.is_terminal:
        console.print()  # a ^C or a half-answered question may stand there
    console.print(Text.assemble(("Error: ", "bold red"), message), soft_wrap=True)


def require_terminal(
    otherwise: str = "there is no terminal to confirm motions at: run in a terminal, or add --yes to run unattended",
) -> None:
    """Raises UsageError, saying `otherwise`, where nobody can answer a question."""
    if not sys.stdin.isatty():
        raise UsageError(otherwise)
