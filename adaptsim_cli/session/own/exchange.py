"""The files of a question and its answer, in the session's folder `questions`; they remain when adaptsim or the program
ends.

questions/trial-003-attempt-1/trial.question.json   one line, as a program gets it on stdin
                              trial.answer.json     as it came; may be corrected by hand
                              trial.run-1.out       output of a program, with .err and .exit
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from adaptsim_cli.errors import AnswerRefused
from adaptsim_cli.screen.outputs.exchange import Answer, Question
from adaptsim_cli.screen.release import Release, digest_of
from adaptsim_cli.session.own.reading import MOST_BYTES, read_answer
from adaptsim_cli.storage import durable
from hw.bounded import Unreadable, read_bytes
from sim.adaptation.sessions import Progress
from sim.adaptation.stages import TrialKey


@dataclass(frozen=True)
class Exchange:
    """One question of one attempt, and its answer."""

    folder: Path  # of the attempt
    ask: str  # "trial" or "place"

    @classmethod
    def of(cls, questions: Path, key: TrialKey, ask: str) -> Exchange:
        """The exchange of an attempt, below the session's folder of questions."""
        return cls(questions / f"trial-{key.number:03d}-attempt-{key.attempt + 1}", ask)

    @property
    def digest(self) -> str:
        """The motion that its question asks for, in the words of `screen.release`."""
        return digest_of(str(self.folder), self.ask)

    @property
    def question_file(self) -> Path:
        """One line of JSON."""
        return self.folder / f"{self.ask}.question.json"

    @property
    def answer_file(self) -> Path:
        """The answer as it came, or as a person corrected it."""
        return self.folder / f"{self.ask}.answer.json"

    def pose(self, question: Question) -> None:
        """Keep the question."""
        if not self.question_file.exists():
            durable.make_folder(self.folder)
            content = json.dumps(question.model_dump(mode="json"), allow_nan=False) + "\n"
            durable.write_file(self.question_file, content.encode())

    def question(self) -> Question:
        """The question that was kept."""
        return Question.model_validate_json(self.question_file.read_bytes())

    def keep(self, content: bytes) -> None:
        """Keep an answer without checking it."""
        durable.replace_file(self.answer_file, content)

    def answer(self) -> Answer | None:
        """The answer, or None if there is none yet. Raises AnswerRefused."""
        try:
            content = read_bytes(self.answer_file, MOST_BYTES)
        except FileNotFoundError:
            return None
        except Unreadable as error:
            raise AnswerRefused(f"it {error}") from error
        return read_answer(content, self.question())


class Mover(Protocol):
    """States whether something real may move, and who consents to it."""

    @property
    def title(self) -> str:
        """Its name for an operator."""

    @property
    def moves(self) -> bool:
        """Whether something real moves, so that an interrupted attempt is spent."""

    @property
    def needs_consent(self) -> bool:
        """Whether a person at the terminal confirms every motion, also with --yes."""

    @property
    def release(self) -> Release:
        """The questions that let the motion begin. There are none without an arm."""


class Answerer(Mover, Protocol):
    """Who answers: a program, a person, or a caller of the Python interface."""

    @property
    def announcement(self) -> str:
        """The effect of the operator's agreement, one sentence without a full stop."""

    @property
    def then(self) -> str:
        """The consequence of that answer."""

    def ask(self, exchange: Exchange, question: Question, progress: Progress) -> None:
        """Returns once the answer is kept in the exchange.

        Raises AnswerAwaited if it comes later, AnswerRefused if there is none, StoppedByOperator.
        """
