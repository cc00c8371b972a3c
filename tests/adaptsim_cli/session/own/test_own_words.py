"""A robot is asked in the task's own words: its categories, and the ends of a trial."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import adaptsim
from adaptsim_cli.session.folders import QUESTIONS
from adaptsim_cli.session.own.exchange import Exchange
from adaptsim_cli.session.own.mailbox import Mailbox
from adaptsim_cli.session.own.person import TypedAnswers
from adaptsim_cli.session.own.target import OwnTarget
from adaptsim_cli.session.trial_records import ended_in_words
from perception.types import ObjectTrack, Outcome
from sim.adaptation.sessions import silently
from sim.adaptation.stages import TrialKey
from sim.tasks.task import Task


@adaptsim.task(
    parameters={"mu": (0.1, 0.3)},
    context={"ground": ("ice", "wood")},
    action={"push": (1.0, 3.0, "m/s"), "tip": ("soft", "hard")},
    state={"x": (0.0, 4.0, "m")},
    duration=1.0,
    moments=[1.0],
    reward=lambda end: 1 - abs(end.x - 1.0),
    outcomes={"in the bin": lambda end: end.x > 0.9, "short of it": None},
)
def bin_shot(p, context, action):
    """Push a stone into a bin."""
    return [1.0], [[action.push * (0.4 if context.ground == "wood" else 0.6)]]


TASK: Task = bin_shot
KEY = TrialKey(1, 0)


class TypingScreen:
    """A person who types these lines."""

    def __init__(self, *lines: str) -> None:
        self.lines, self.questions, self.notes = list(lines), list[str](), list[str]()

    def words(self, question: str, hint: str) -> str:
        self.questions.append(question)
        return self.lines.pop(0)

    def note(self, text: str) -> None:
        self.notes.append(text)

    def show(self, text: object) -> None:
        self.notes.append(str(text))


@pytest.fixture
def target(tmp_path: Path) -> OwnTarget:
    return OwnTarget(TASK, tmp_path, Mailbox(), "adaptsim")


def asked(target: OwnTarget, ask: str, *lines: str) -> tuple[TypingScreen, Exchange]:
    screen, exchange = TypingScreen(*lines), Exchange.of(target.session / QUESTIONS, KEY, ask)
    action = None if ask == "place" else np.array([2.0, 1.0])
    question = target._question(ask, KEY, np.array([1.0]), action)
    exchange.pose(question)
    TypedAnswers(screen, TASK).ask(exchange, question, silently)  # type: ignore[arg-type]
    return screen, exchange


def test_a_question_has_its_categories_in_words(target):
    question = target._question("trial", KEY, np.array([1.0]), np.array([2.0, 1.0]))
    assert question.words == {"ground": "wood", "tip": "hard"}
    assert question.action == {"push": 2.0, "tip": 1.0}


def test_a_person_types_the_word_of_a_measured_category(target):
    screen, exchange = asked(target, "place", "sand", "ice")
    assert screen.questions[0] == "ground, one of ice, wood (Enter: wood):"
    assert "sand is none of ice, wood" in " ".join(screen.notes)
    assert "ground = wood" in screen.notes[0]
    answer = exchange.answer()
    assert answer is not None
    assert answer.context == {"ground": 0.0}


def test_a_person_is_not_asked_for_the_only_outcome_and_the_end_has_the_words_of_the_task(target):
    screen, exchange = asked(target, "trial", "", "0.95", "")
    assert not any("How did it end" in question for question in screen.questions)
    answer = exchange.answer()
    assert answer is not None
    assert answer.outcome is Outcome.SETTLED
    for x, words in ((0.95, "in the bin"), (0.5, "short of it")):
        track = ObjectTrack(np.ones(1), np.array([[x]]), Outcome.SETTLED, np.full(3, np.nan), np.ones(1))
        assert ended_in_words(TASK, track) == words
