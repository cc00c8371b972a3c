"""The open questions of a stored session, and how an answer is kept."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.session.folders import QUESTIONS
from adaptsim_cli.session.own.exchange import Exchange
from adaptsim_cli.session.own.reading import measured_context, read_answer, track_of
from adaptsim_cli.session.store import SessionStore
from sim.adaptation.stages import TrialKey
from sim.tasks import get_task

_ATTEMPT = re.compile(r"trial-(\d+)-attempt-(\d+)")


def open_questions(store: SessionStore) -> tuple[Question, ...]:
    """The questions without an answer, in the order of their trials; without those of rejected attempts."""
    existing = store.existing()
    over = existing.completed | existing.recorded | existing.rejected
    questions = []
    for folder in sorted((store.folder / QUESTIONS).glob("trial-*")):
        match = _ATTEMPT.fullmatch(folder.name)
        if match is None or TrialKey(int(match[1]), int(match[2]) - 1) in over:
            continue
        for ask in ("place", "trial"):
            exchange = Exchange(folder, ask)
            if exchange.question_file.exists() and not exchange.answer_file.exists():
                questions.append(exchange.question())
    return tuple(questions)


def keep(store: SessionStore, question: Question, table: Mapping[str, Any]) -> None:
    """Check an answer and keep it. Raises AnswerRefused, and keeps nothing."""
    task = get_task(question.task)
    content = (json.dumps(table) + "\n").encode()
    answer = read_answer(content, question)
    if not (answer.rejected or answer.impossible):
        if question.ask == "place":
            measured_context(answer, question, task)
        else:
            track_of(answer, question, task)
    key = TrialKey(question.trial, question.attempt - 1)
    Exchange.of(store.folder / QUESTIONS, key, question.ask).keep(content)
