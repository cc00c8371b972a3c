"""Every print, prompt, table and progress bar.

Data go to stdout; with `--json`, all text for a person goes to stderr. Rich obeys NO_COLOR and TERM=dumb and
measures the terminal.
"""

from __future__ import annotations

import json
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen import loading, views
from adaptsim_cli.screen.keys import HELP, Key, chosen, enter, explained, lines_typed, prompt, read_line, stop, unknown
from adaptsim_cli.screen.pages import addressed
from adaptsim_cli.screen.reply import Reply, Step
from adaptsim_cli.screen.stopwatch import Stopwatch
from adaptsim_cli.screen.views import Readiness

if TYPE_CHECKING:
    from pydantic import BaseModel
    from rich.progress import TaskID


ANSWERING = "answering"
"""The stage of the time spent waiting for answers."""
NAME = "Type a name or initials, as every record should show it, then Enter; q ends the command."
END = "(end of input)"
"""The answer that listeners get at the end of input."""


class Listener(Protocol):
    """A listener that shows the terminal's events elsewhere."""

    def doing(self, what: str, stage: str) -> None:
        """A step, `what`, of a stage (see `Screen.busy`) begins."""

    def did(self, what: str, stage: str, took_s: float) -> None:
        """The step is over."""

    def asking(self, question: str) -> None:
        """The terminal waits for an answer to `question`."""

    def answered(self, question: str, answer: str, took_s: float) -> None:
        """The question is answered."""

    def noted(self, text: str) -> None:
        """A highlighted line was printed."""


class Screen:
    """The terminal, or its stand-in."""

    def __init__(self, *, as_json: bool = False, console: Console | None = None) -> None:
        loading.clear()
        self._as_json = as_json
        self._console = console or CleanConsole(stderr=as_json, highlight=False, markup=False)
        self._live = self._console.is_terminal and not self._console.is_dumb_terminal
        self._listeners: list[Listener] = []
        self._noted: list[str] = []
        self._stopwatch = Stopwatch()

    def add_listener(self, listener: Listener) -> None:
        """From now on, `listener` also gets every wait, question, answer and warning; it gets earlier warnings now."""
        for text in self._noted:
            listener.noted(text)
        self._listeners.append(listener)

    def tell_listeners(self, text: str) -> None:
        """A line only for the listeners."""
        for listener in self._listeners:
            listener.noted(text)

    def lap_s(self) -> dict[str, float]:
        """The time in s since the last call, by stage. The stages add up to the whole time."""
        return self._stopwatch.lap_s()

    @property
    def as_json(self) -> bool:
        """Whether stdout is only for JSON."""
        return self._as_json

    @property
    def width(self) -> int:
        """Columns of the terminal."""
        return self._console.width

    def show(self, what: RenderableType) -> None:
        """Print text, a table or any other renderable of rich."""
        self._console.print(what)

    def plain(self, text: str) -> None:
        """Print one unwrapped line, so that paths can be copied."""
        self._console.print(Text(text), soft_wrap=True)

    def file(self, what: str, path: Path) -> None:
        """Print what a file or folder is and its place (`views.FileLine`)."""
        self.print([views.FileLine(what, path)])

    def print(self, text: Iterable[RenderableType]) -> None:
        """Print each part: a string or the place of a file unwrapped, any other renderable as rich does."""
        for part in text:
            if isinstance(part, str):
                self.plain(part)
            elif isinstance(part, views.FileLine):
                self._console.print(part, soft_wrap=True)
            else:
                self.show(part)

    def note(self, text: str) -> None:
        """Print a highlighted line."""
        self.show(Text(text, style="yellow"))
        self._noted.append(text.strip())
        self.tell_listeners(text.strip())

    def data(self, command: str, value: Mapping[str, Any] | BaseModel) -> bool:
        """With --json, print the output of `command` on one line of stdout, checked against its model, version first.

        Returns whether it did; text for a person then goes to stderr.
        """
        if not self._as_json:
            return False
        from adaptsim_cli.screen.outputs import catalogue

        sys.stdout.write(json.dumps(catalogue.output(command, value), allow_nan=False) + "\n")
        sys.stdout.flush()
        return True

    def end(self, command: str, reply: Reply) -> None:
        """Print the reply of `command`: with --json its data, else its text and the next commands.

        Raises its failure.
        """
        if reply.data is None or not self.data(command, reply.data):
            self.print(reply.text)
            self.next(*reply.next)
        if reply.failure is not None:
            raise reply.failure

    def choose(self, question: str, *keys: Key, explain: str = "", listed: Sequence[Key] = ()) -> str:
        """Ask until one of the `keys` is typed, and return it ("" for Enter).

        The question names all keys, or those `listed`.
        `?` shows `explain`, then the meaning of each key. Any other answer is named and changes nothing. Raises
        StoppedByOperator at the end of input.
        """
        while True:
            answer = self.ask(f"{question} {prompt(listed or keys)}:")
            if answer == HELP:
                self.show(views.keys(explain, explained(keys)))
            elif (key := chosen(keys, answer)) is not None:
                return key.typed
            else:
                self.note(f"  {unknown(answer, listed or keys)}")

    def go_on(
        self,
        question: str,
        does: str = "to go on",
        *,
        then: str,
        assurance: str = "everything completed is stored",
    ) -> None:
        """Wait for Enter; `then` describes its effect, `assurance` the state after q. Raises StoppedByOperator at q."""
        if self.choose(question, enter(does, then), stop(f"The command ends; {assurance}.")) == "q":
            raise StoppedByOperator(f"stopped by the operator; {assurance}")

    def words(self, question: str, explain: str = "Type the answer and press Enter; q leaves.") -> str | None:
        """Ask for a sentence; "" if it is empty, None at q, `explain` at `?`. Raises StoppedByOperator."""
        while (answer := self.ask_text(question)) == HELP:
            self.show(views.indent(Text(explain)))
        return None if answer in ("q", "Q") else answer

    def name(self, question: str, assurance: str) -> str:
        """Ask for the name of a person until one is typed. Raises StoppedByOperator with `assurance` at q."""
        while (answer := self.words(f"{question} Your name goes into the record:", NAME)) == "":
            self.note(f"  Enter alone names nobody. {NAME}")
        if answer is None:
            raise StoppedByOperator(assurance)
        return answer

    def length(self, question: str, otherwise: float) -> float:
        """Ask until the answer is a positive number; Enter gives `otherwise`. Raises StoppedByOperator at q."""
        while (answer := self.words(question)) is not None:
            with suppress(ValueError):
                if (value := float(answer.replace(",", ".")) if answer else otherwise) > 0.0:
                    return value
            self.note(f"  {answer} is not one of these numbers; for example {otherwise:g}")
        raise StoppedByOperator("stopped by the operator; nothing has changed")

    def ask(self, question: str) -> str:
        """One line of answer, lower case and stripped. Raises StoppedByOperator at the end of input."""
        return self.ask_text(question).lower()

    def ask_text(self, question: str) -> str:
        """One line of answer as it was typed, stripped. Raises StoppedByOperator at the end of input."""
        self._console.print(Text(question, style="bold"), end=" ")
        for listener in self._listeners:
            listener.asking(question)
        began = time.monotonic()
        with self._stopwatch.stage(ANSWERING):
            answer = read_line()
        for listener in self._listeners:
            listener.answered(question, answer.strip(" \t\r\n") if answer else END, time.monotonic() - began)
        if not answer:
            raise StoppedByOperator("the input ended; everything completed is stored")
        return answer.strip(" \t\r\n")

    def has_typed(self, key: Key) -> bool:
        """Whether somebody has typed `key` and Enter since the last question, while the program worked."""
        return key.typed in lines_typed()

    @contextmanager
    def busy(self, what: str, stage: str = "") -> Iterator[None]:
        """Show a running step with its time so far; without a terminal, a line afterwards if it took a second.

        `stage` is the word under which `lap_s` adds up the time.
        """
        began = time.monotonic()
        for listener in self._listeners:
            listener.doing(what, stage or what)
        with self._stopwatch.stage(stage or what), self._waiting(what, began):
            yield
        took_s = time.monotonic() - began
        for listener in self._listeners:
            listener.did(what, stage or what, took_s)

    @contextmanager
    def _waiting(self, what: str, began: float) -> Iterator[None]:
        if self._live:
            from rich.live import Live

            waiting = Live(
                get_renderable=lambda: views.waiting(what, time.monotonic() - began),
                console=self._console,
                transient=True,
                refresh_per_second=8,
            )
            with waiting:
                yield
        else:
            yield
            if (took_s := time.monotonic() - began) >= 1.0:
                self.show(Text(f"  {what}: {took_s:.0f} s", style="dim"))

    @contextmanager
    def progress(self) -> Iterator[Callable[[str, int, int], None]]:
        """Yields `update(stage, done, total)`: a bar per stage on a terminal, else a line every tenth."""
        if self._live:
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            with Progress(*columns, console=self._console) as bars:
                rows: dict[str, TaskID] = {}

                def draw(stage: str, done: int, total: int) -> None:
                    if stage not in rows:
                        rows[stage] = bars.add_task(stage, total=total)
                    bars.update(rows[stage], completed=done, total=total)

                yield draw
        else:
            shown_tenths: set[tuple[str, int]] = set()
            began: dict[str, tuple[float, int]] = {}  # start time of each stage, and its count then

            def say(stage: str, done: int, total: int) -> None:
                tenth = 10 * done // max(total, 1)
                since, before = began.setdefault(stage, (time.monotonic(), done))
                if (stage, tenth) not in shown_tenths:
                    shown_tenths.add((stage, tenth))
                    left = _left(time.monotonic() - since, done - before, total - done)
                    self.show(Text(f"  {stage}: {10 * tenth} % ({done} of {total}){left}"))

            yield say

    def next(self, *steps: Step) -> None:
        """Show the next commands, the likeliest first, unwrapped, to be copied."""
        for index, (command, why) in enumerate(steps):
            self.plain(f"{'Next: ' if not index else '  or: '}{command}")
            self.show(Text(f"      {why}", style="dim"))

    def resting(self, what: str, sessions: Sequence[str]) -> None:
        """Name the open `sessions`, if there are any, that depend on `what`, which is being replaced."""
        if not sessions:
            return
        many = "s" if len(sessions) > 1 else ""
        self.note(f"Open session{many} that rest{'' if many else 's'} on {what}: {', '.join(sessions)}.")
        self.plain("Once it is replaced, each can continue only with its own, if the camera has not moved:")
        self.plain(f"  adaptsim run-iteration --session {sessions[0]} --own-calibration")

    def checks(self, readiness: Sequence[Readiness]) -> None:
        """Print which checks passed, and the remedy for each that did not."""
        self.show(views.checks(readiness))


def _left(spent_s: float, done: int, missing: int) -> str:
    """The remaining time at the speed so far; empty while unknown, and below ten seconds."""
    seconds = spent_s * missing / done if done else 0.0
    if seconds < 10.0:
        return ""
    return f", {seconds / 60.0:.0f} min left" if seconds >= 90.0 else f", {seconds:.0f} s left"


def error(message: str) -> None:
    """Print one message on stderr, on a line of its own, unwrapped so that commands in it can be copied."""
    _last_words("Error: ", "bold red", message)


def ended(message: str) -> None:
    """Print a message as `error` does, for a command that a person ended, which is not an error."""
    _last_words("", "", message[:1].upper() + message[1:])


def _last_words(mark: str, style: str, message: str) -> None:
    loading.clear()
    console = CleanConsole(stderr=True, highlight=False, markup=False)
    if console.is_terminal:
        console.print()  # the line may hold a ^C or a half-answered question
    console.print(Text.assemble((mark, style), addressed(message)), soft_wrap=True)


NO_TERMINAL = "there is no terminal to confirm motions at: run in a terminal, or add --yes to run unattended"


def require_terminal(otherwise: str = NO_TERMINAL) -> None:
    """Raises UsageError with `otherwise` if no terminal can answer questions."""
    if not sys.stdin.isatty():
        raise UsageError(otherwise)


_COMMANDS = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


class CleanConsole(Console):
    """rich's console; control characters in a text become visible."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """See rich. Control segments of rich itself (a progress bar's) stay."""
        for segment in super().render(renderable, options):
            if segment.control or not _COMMANDS.search(segment.text):
                yield segment
            else:
                yield Segment(clean(segment.text), segment.style)


def clean(text: str) -> str:
    """The text with every control character but the line break made visible, as \\x1b."""
    return _COMMANDS.sub(lambda match: match.group().encode("unicode_escape").decode(), text)
