"""A person who answers at the terminal, with a file of the trajectory, or with the place and time of the object's rest.

A bad value is named at its own question, and asked for again.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from adaptsim_cli.errors import AnswerRefused, StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.outputs.exchange import Answer, Question
from adaptsim_cli.screen.release import Release
from adaptsim_cli.screen.views import value_in_words
from adaptsim_cli.session.own.exchange import Exchange
from adaptsim_cli.session.own.reading import MOST_BYTES, measured_context, read_answer, track_of
from hw.bounded import Unreadable, read_bytes
from hw.records import number_hint
from perception.types import Outcome
from sim.adaptation.sessions import Progress
from sim.tasks.task import Task
from sim.types import Dimension

HELP = (
    "Answer with the numbers that you measured, in the unit of the question. r: this attempt does not count; "
    "i: your robot cannot do this action; q: leave, the same command asks again."
)


class _Said(Exception):
    """The person said that the trial does not count, or that its action is impossible."""

    def __init__(self, table: dict[str, Any]) -> None:
        super().__init__()
        self.table = table


@dataclass(frozen=True)
class TypedAnswers:
    """An `Answerer`: a person at the terminal, who also makes the trial."""

    screen: Screen
    task: Task

    title = "a person answers"
    moves = True
    needs_consent = True
    announcement = "You make this trial with your robot; adaptsim checks none of its motion"
    then = "Make the trial now. Then you are asked how it went."

    @property
    def release(self) -> Release:
        """See `Answerer`; the person moves the robot, so nothing has to be released."""
        return Release()

    def ask(self, exchange: Exchange, question: Question, progress: Progress) -> None:
        """See `Answerer`. Raises StoppedByOperator."""
        try:
            table = self._place(question) if question.ask == "place" else self._trial(question)
        except _Said as refusal:
            table = refusal.table
        exchange.keep((json.dumps({"trial": question.trial, **table}) + "\n").encode())

    def _place(self, question: Question) -> dict[str, Any]:
        dimensions = dict(zip(self.task.context.names, self.task.context.dimensions, strict=True))
        where = ", ".join(
            f"{name} = {question.words.get(name) or f'{value:.4g} {question.units[name]}'}"
            for name, value in question.context.items()
        )
        self.screen.show(f"  Set the object up near {where.strip()}, and measure where it lies.")
        while True:
            context = {
                name: self._kind(dimensions[name], drawn)
                if dimensions[name].words
                else self._number(f"{name} [{question.units[name] or '-'}] (Enter: {drawn:.4g}):", drawn)
                for name, drawn in question.context.items()
            }
            answer = Answer(trial=question.trial, context=context)
            if self._fits(partial(measured_context, answer, question, self.task)):
                return {"context": context}

    def _trial(self, question: Question) -> dict[str, Any]:
        while True:
            table = self._from_file(question) or self._end(question)
            if "outcome" not in table and len(question.outcomes) == 1:
                table["outcome"] = question.outcomes[0].value
            elif "outcome" not in table:
                table["outcome"] = self._outcome(question)
            if question.needs and table["outcome"] in question.success and "end_in_tool_m" not in table:
                axes = [self._number(f"Last place in the tool's frame, {axis} [m]:") for axis in "xyz"]
                table["end_in_tool_m"] = axes
            if self._fits(partial(self._track, {"trial": question.trial, **table}, question)):
                return table

    def _track(self, table: dict[str, Any], question: Question) -> None:
        track_of(read_answer(json.dumps(table).encode(), question), question, self.task)

    def _fits(self, check: Callable[[], object]) -> bool:
        try:
            check()
        except AnswerRefused as error:
            self.screen.note(f"  That cannot be: {error}.")
            return False
        return True

    def _from_file(self, question: Question) -> dict[str, Any] | None:
        """The table of a CSV or JSON file; None: there is no file."""
        while named := self._words("File with the trajectory, CSV or JSON (Enter: none, only its end):"):
            try:
                return of_file(Path(named).expanduser(), question)
            except AnswerRefused as error:
                self.screen.note(f"  {named}: {error}.")
        return None

    def _end(self, question: Question) -> dict[str, Any]:
        end = [self._number(f"Where did it come to rest? {column}:") for column in question.state]
        rest_s = self._number("After how many seconds from the start of the motion? (Enter: not measured):", math.nan)
        return {"end": end} if math.isnan(rest_s) else {"end": end, "rest_s": rest_s}

    def _outcome(self, question: Question) -> str:
        choices = {str(n): outcome for n, outcome in enumerate(question.outcomes, start=1)}
        listed = ", ".join(f"{n} {outcome.value}" for n, outcome in choices.items())
        while True:
            typed = self._words(f"How did it end? {listed}:")
            outcome = choices.get(typed) or next(
                (o for o in Outcome if o.value == typed and o in question.outcomes), None
            )
            if outcome is not None:
                return outcome.value
            self.screen.note(f"  {typed or 'Enter alone'} is none of them.")

    def _kind(self, dimension: Dimension, drawn: float) -> float:
        """The index of a category that is typed as its word."""
        kinds = ", ".join(dimension.words)
        while True:
            typed = self._words(f"{dimension.name}, one of {kinds} (Enter: {value_in_words(dimension, drawn)}):")
            if not typed:
                return drawn
            if typed in dimension.words:
                return float(dimension.words.index(typed))
            self.screen.note(f"  {typed} is none of {kinds}.")

    def _number(self, question: str, otherwise: float | None = None) -> float:
        while True:
            typed = self._words(question)
            if not typed and otherwise is not None:
                return otherwise
            try:
                value = float(typed)
            except ValueError:
                self.screen.note(f"  {typed or 'Enter alone'} is not a number; write it with a point, e.g. 0.85.")
                continue
            if math.isfinite(value):
                return value
            self.screen.note(f"  {typed} is not finite.")

    def _words(self, question: str) -> str:
        """One answer. Raises _Said at r or i, StoppedByOperator at q."""
        typed = self.screen.words(question, HELP)
        if typed is None:
            raise StoppedByOperator("stopped by the operator; the same command asks for this trial again")
        if typed.lower() in ("r", "i"):
            key = "rejected" if typed.lower() == "r" else "impossible"
            reason = self.screen.words("Why? One sentence (q: back):", HELP)
            if reason:
                raise _Said({key: reason})
            return self._words(question)
        return typed


def of_file(path: Path, question: Question) -> dict[str, Any]:
    """The keys of an answer in a JSON file, or times and states of a CSV table. Raises AnswerRefused."""
    try:
        content = read_bytes(path, MOST_BYTES)
    except FileNotFoundError as error:
        raise AnswerRefused("there is no such file") from error
    except (Unreadable, OSError, ValueError) as error:
        raise AnswerRefused(f"it {error}") from error
    if path.suffix.lower() == ".csv":
        return _of_csv(content, question)
    try:
        table = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise AnswerRefused(f"it is no JSON: {error}") from error
    if not isinstance(table, dict):
        raise AnswerRefused("it must be one JSON object, for example with t_s and state")
    return {key: value for key, value in table.items() if key != "trial"}


def _of_csv(content: bytes, question: Question) -> dict[str, Any]:
    names = ["t_s", *(column.partition(" ")[0] for column in question.state)]
    try:
        lines = [line for line in csv.reader(io.StringIO(content.decode("utf-8-sig"), newline="")) if any(line)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise AnswerRefused(f"it is no CSV table: {error}") from error
    head = [cell.strip() for cell in lines[0]] if lines else []
    if missing := [name for name in names if name not in head]:
        raise AnswerRefused(f"it has no column {missing[0]!r}; its first line must name {', '.join(names)}")
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            rows.append([float(line[head.index(name)]) for name in names])
        except (ValueError, IndexError) as error:
            hint = next((hint for cell in line if "," in cell and (hint := number_hint(cell))), "")
            raise AnswerRefused(f"line {number} does not hold a number for each of {', '.join(names)}{hint}") from error
    return {"t_s": [row[0] for row in rows], "state": [row[1:] for row in rows]}
