"""Every print, prompt, table and progress bar.

Data go to stdout; with `--json` everything that a person reads goes to stderr. Rich obeys NO_COLOR and TERM=dumb and
measures the terminal.
"""

from __future__ import annotations

import json
import sys
import termios
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.text import Text

from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen import views
from adaptsim_cli.session.operator import Accept, Judged, Overrule, Proposal, Redo, Review
from perception.types import Outcome

if TYPE_CHECKING:
    from adaptsim_cli.session.preflight import Check
    from adaptsim_cli.session.records import Facts, ResultRecord, TrialRecord
    from adaptsim_cli.session.stages import RunTrial
    from hw.types import Array
    from sim.adaptation.method import Particle
    from sim.tasks.task import Task


class Screen:
    """The terminal, or what stands for it."""

    def __init__(self, *, as_json: bool = False, console: Console | None = None) -> None:
        self._console = console or Console(stderr=as_json, highlight=False, markup=False)
        self._live = self._console.is_terminal and not self._console.is_dumb_terminal

    @property
    def width(self) -> int:
        return self._console.width

    def show(self, what: RenderableType) -> None:
        self._console.print(what)

    def plain(self, text: str) -> None:
        """One line as it is, whatever the width: paths can be copied."""
        self._console.print(Text(text), soft_wrap=True)

    def note(self, text: str) -> None:
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

            def say(stage: str, done: int, total: int) -> None:
                tenth = 10 * done // max(total, 1)
                if (stage, tenth) not in said:
                    said.add((stage, tenth))
                    self.show(Text(f"  {stage}: {10 * tenth} % ({done} of {total})"))

            yield say

    def session(self, task: Task, facts: Facts, iteration: int, hardware: str) -> None:
        self.show(views.session_header(task, facts, iteration, hardware))

    def checks(self, found: Sequence[Check]) -> None:
        self.show(views.checks(found))

    def trial(self, task: Task, facts: Facts, stage: RunTrial, particle: Particle) -> None:
        self.show(views.trial(task, facts, stage, particle))

    def proposal(self, task: Task, made: Proposal) -> None:
        self.show(views.proposal(task, made))

    def trial_done(self, record: TrialRecord, *, manual: bool) -> None:
        self.show(views.trial_done(record, manual=manual))

    def adapted(self, task: Task, before: Sequence[Particle], after: Sequence[Particle], result: ResultRecord) -> None:
        self.show(views.adapted(task, before, after, result, self.width))


def error(message: str) -> None:
    """One clear message on stderr, on a line of its own, and unbroken so that commands in it can be copied."""
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


@dataclass(frozen=True)
class Attended:
    """A person at the terminal answers."""

    screen: Screen

    def repeat_interrupted(self, stage: RunTrial, real: bool) -> None:
        self.screen.note(
            f"Trial {stage.key.number} was interrupted after its motion had started: "
            "the arm and the object may have moved."
        )
        self._go_on("Is the arm at rest and the way clear? Enter to do this trial again, q to stop:")

    def placed(self, what: str, wanted_m: Array, real: bool) -> None:
        if real:
            self._go_on(f"Put the {what} at {_spot(wanted_m)}. Enter when it lies there, q to stop:")
        else:
            self._go_on(f"The simulated lab puts the {what} at {_spot(wanted_m)}. Enter to go on, q to stop:")

    def approve(self, proposal: Proposal, real: bool) -> None:
        if proposal.overlay is not None:
            self.screen.plain(f"  What the camera found: {proposal.overlay}")
        self._go_on(f"{proposal.announced}. Enter to start, q to stop:")

    def review(self, judged: Judged) -> Review:
        self.screen.show(f"  Tracked: {judged.outcome.value.replace('_', ' ')}, reward {judged.reward:.2f}")
        for flag in judged.flags:
            self.screen.note(f"  note: {flag}")
        overrule = "o to overrule the outcome, " if judged.possible else ""
        while True:
            answer = self.screen.ask(f"Enter to accept, {overrule}r to redo this trial, q to stop:")
            if answer == "":
                return Accept()
            if answer == "q":
                raise StoppedByOperator("stopped by the operator; this trial is recorded, and its review comes again")
            if answer == "r":
                reason = self.screen.ask("Why does this trial not count?")
                return Redo(reason or "the operator had it redone")
            if answer == "o" and judged.possible and (outcome := self._other_outcome(judged)) is not None:
                return Overrule(outcome)

    def try_again(self, stage: RunTrial, problem: str, moved: bool) -> bool:
        self._go_on("Enter to set this trial up again, q to stop:")
        return True

    def _other_outcome(self, judged: Judged) -> Outcome | None:
        choices = judged.possible
        for index, (outcome, reward) in enumerate(choices, start=1):
            self.screen.show(f"  {index}  {outcome.value.replace('_', ' ')} (reward {reward:.2f})")
        answer = self.screen.ask("Number of the outcome that you saw, Enter to go back:")
        if answer.isdigit() and 1 <= int(answer) <= len(choices):
            return choices[int(answer) - 1][0]
        return None

    def _go_on(self, question: str) -> None:
        while (answer := self.screen.ask(question)) != "":
            if answer == "q":
                raise _stopped()


@dataclass(frozen=True)
class Unattended:
    """`--yes`: nobody answers. Never confirms the motion of a real arm: `wiring` gives a real one to `Attended`."""

    screen: Screen
    most_attempts: int = 5

    def repeat_interrupted(self, stage: RunTrial, real: bool) -> None:
        self.screen.note(
            f"Trial {stage.key.number} was interrupted after its motion had started. "
            "The simulated lab starts afresh, so it is done again from the same start."
        )

    def placed(self, what: str, wanted_m: Array, real: bool) -> None:
        self.screen.show(Text(f"  The simulated lab puts the {what} at {_spot(wanted_m)}", style="dim"))

    def approve(self, proposal: Proposal, real: bool) -> None:
        if real:
            raise UsageError("--yes never confirms the motion of a real arm; run without it, at a terminal")

    def review(self, judged: Judged) -> Review:
        return Accept()

    def try_again(self, stage: RunTrial, problem: str, moved: bool) -> bool:
        return stage.key.attempt + 1 < self.most_attempts


def _spot(xy_m: Array) -> str:
    return f"x = {xy_m[0]:.3f} m, y = {xy_m[1]:+.3f} m"


def _stopped() -> StoppedByOperator:
    return StoppedByOperator("stopped by the operator; everything completed is stored")
