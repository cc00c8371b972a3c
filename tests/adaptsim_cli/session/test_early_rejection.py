"""An operator who has seen a trial fail rejects it while the arm goes back, and it is not tracked first."""

from __future__ import annotations

import os
import pty
import select
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from real_lab import quiet, said
from toy_rig import ToyLab
from toy_session import ScriptedOperator, attended

from adaptsim_cli.screen.keys import lines_typed
from adaptsim_cli.session.flow import run_iteration
from adaptsim_cli.session.operator import Attended


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The other end of the terminal at which the program reads."""
    master, slave = pty.openpty()
    with os.fdopen(slave) as terminal:
        monkeypatch.setattr("sys.stdin", terminal)
        yield master
    os.close(master)


def arrives(keyboard: int, text: str) -> None:
    os.write(keyboard, text.encode())
    assert select.select([sys.stdin], [], [], 5.0)[0], "the terminal has a whole line"


def test_lines_typed_while_the_program_works_are_read_without_waiting(keyboard: int) -> None:
    assert lines_typed() == []
    arrives(keyboard, "x\n R \nnot yet ended")
    assert lines_typed() == ["x", "r"]
    assert lines_typed() == []


@pytest.mark.parametrize(("reason", "review"), [("it slipped", "it slipped"), ("q", "")])
def test_r_asks_why_and_q_takes_it_back(keyboard: int, reason: str, review: str) -> None:
    screen = quiet()
    operator = Attended(screen)
    assert operator.rejected_already() == ""
    assert "Why does" not in said(screen)
    arrives(keyboard, "r\n")
    answer = threading.Timer(0.3, os.write, (keyboard, f"{reason}\n".encode()))
    answer.start()
    assert operator.rejected_already() == review
    assert "Why does this trial not count?" in said(screen)
    answer.join()


class Early(ScriptedOperator):
    """Rejects the first attempt of the second trial."""

    looks = 0

    def rejected_already(self) -> str:
        self.looks += 1
        return "the piece was touched" if self.looks == 2 else ""


def test_a_trial_rejected_on_the_way_back_is_not_tracked_and_made_again(tmp_path: Path) -> None:
    operator = Early()
    session = attended(tmp_path, operator, ToyLab(0))
    run_iteration(session)
    assert operator.looks == 5
    rejections = [(change.key.number, change.note.text) for change in session.store.rejections()]
    assert rejections == [(2, "the piece was touched")]
    assert not list(session.store.folder.glob("**/trial-002-attempt-1/trial.json"))
    assert len(session.store.existing().completed) == 4
