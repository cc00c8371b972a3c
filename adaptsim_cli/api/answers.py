"""Trials that your own robot is asked for, and its answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from adaptsim_cli import config
from adaptsim_cli.api.progress import silent
from adaptsim_cli.errors import AnswerAwaited, UsageError
from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.session.own.telling import keep, open_questions
from adaptsim_cli.session.store import SessionStore
from hw.types import Array


def require_own(store: SessionStore) -> None:
    """Raises UsageError for a session in the simulated lab or on an arm of ours."""
    facts = store.facts
    if not config.is_own(facts.hw):
        raise UsageError(
            f"session {facts.name!r} has hw = {facts.hw}, so it makes its trials itself: call run() or "
            f'run_iteration(). To make them yourself, begin one with adaptsim.begin("{facts.task}", hw="own")'
        )


def open_trials(store: SessionStore) -> tuple[Question, ...]:
    """All trials that may be made now."""
    require_own(store)
    if not (questions := open_questions(store)):
        go_on(store)
        questions = open_questions(store)
    if not questions:  # the last answers completed an iteration
        go_on(store)
        questions = open_questions(store)
    return questions


def keep_answer(store: SessionStore, trial: Question, answer: Mapping[str, Any]) -> None:
    """Keep the answer to an open trial, and go on. Raises AnswerRefused, UsageError."""
    require_own(store)
    key = (trial.trial, trial.attempt, trial.ask)
    if not any((one.trial, one.attempt, one.ask) == key for one in open_questions(store)):
        raise UsageError(f"trial {trial.trial} is not open: it was reported already, or another session asked for it")
    keep(store, trial, {"trial": trial.trial, **{name: value for name, value in answer.items() if value is not None}})
    go_on(store)


def go_on(store: SessionStore) -> None:
    """Take the answer, and go on until the next answers are awaited or an iteration is complete."""
    from functools import partial

    from adaptsim_cli.session import opening, running
    from adaptsim_cli.session.own.mailbox import Mailbox
    from adaptsim_cli.show.first_look import with_first_look
    from adaptsim_cli.show.reports import Reports

    request = running.SessionRequest(store.facts.name, frozenset(), yes=True)
    opener = partial(opening.open_parts, answerer=Mailbox())
    settings = config.load({"answer_with": "", "answer_moves": "robot"})
    view = with_first_look(running.terminal_alone)
    with suppress(AnswerAwaited):
        running.run_session(settings, request, opener, Reports().draw, silent(), view)


def numbers(values: Sequence[Any] | Array | None) -> list[Any] | None:
    """An array as nested lists of numbers."""
    if values is None:
        return None
    row: list[Any] = np.asarray(values, dtype=np.float64).tolist()
    return row
