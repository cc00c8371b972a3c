"""The caller of `Session.ask` and `Session.tell` answers: a question stays open until its answer is given."""

from __future__ import annotations

from dataclasses import dataclass

from adaptsim_cli.errors import AnswerAwaited
from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session.own.exchange import Exchange
from sim.adaptation.sessions import Progress


@dataclass(frozen=True)
class Mailbox:
    """An `Answerer` that never waits. A caller consents to the requested motion."""

    title = "asked and told from Python"
    moves = True
    needs_consent = False
    announcement = "The trial is asked for"
    then = "The question stays open until its answer is told."

    @property
    def release(self) -> Release:
        """See `Answerer`; nobody is asked."""
        return Release()

    def ask(self, exchange: Exchange, question: Question, progress: Progress) -> None:
        """See `Answerer`. Raises AnswerAwaited."""
        raise AnswerAwaited(f"trial {question.trial} waits for its answer: session.tell(trial, ...)")
