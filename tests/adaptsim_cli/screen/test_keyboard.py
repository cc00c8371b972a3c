"""Typing at a terminal of one's own: what counts as an answer, and what Esc does."""

from __future__ import annotations

import io
import os
import pty
import select
import sys
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from rich.console import Console

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import ESCAPE, enter, read_line, stop


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The end of a terminal where keys are pressed; standard input is the other one."""
    ours, theirs = pty.openpty()
    stdin = os.fdopen(theirs, "r+b", buffering=0)
    monkeypatch.setattr("sys.stdin", stdin)
    yield ours
    stdin.close()
    os.close(ours)


@contextmanager
def pressing(keyboard: int, keys: bytes) -> Iterator[None]:
    """Presses the keys once a question waits for them: until then the terminal collects lines."""

    def press() -> None:
        while termios.tcgetattr(keyboard)[3] & termios.ICANON:
            time.sleep(0.005)
        os.write(keyboard, keys)

    presser = threading.Thread(target=press)
    presser.start()
    yield
    presser.join()


@pytest.mark.parametrize(
    ("keys", "answer"),
    [
        (b"yes\n", "yes\n"),
        (b"\r", "\n"),
        (b"noo\x7f\n", "no\n"),
        (b"all wrong\x15right\n", "right\n"),
        ("grün\n".encode(), "grün\n"),
        (b"a\x1b[Ab\n", "ab\n"),  # an arrow key is no Esc
        (b"\x1b", ESCAPE),
        (b"half a word\x1b", ESCAPE),
        (b"\x04", ""),
    ],
)
def test_a_line_ends_with_enter_and_esc_needs_none(keyboard: int, keys: bytes, answer: str) -> None:
    with pressing(keyboard, keys):
        assert read_line() == answer


def test_an_enter_typed_ahead_starts_nothing(keyboard: int) -> None:
    said = io.StringIO()
    screen = Screen(console=Console(file=said, width=80))
    os.write(keyboard, b"\n\n\n")
    assert select.select([sys.stdin], [], [], 10.0)[0]  # they have arrived
    with pressing(keyboard, b"q\n"):
        assert screen.choose("Is the work area clear?", enter("to start", "It moves."), stop("It ends.")) == "q"
    assert said.getvalue().count("Is the work area clear?") == 1


def test_typing_is_echoed_and_the_terminal_is_as_before(keyboard: int) -> None:
    before = termios.tcgetattr(keyboard)
    with pressing(keyboard, b"hand\n"):
        read_line()
    assert termios.tcgetattr(keyboard) == before
    assert b"hand" in os.read(keyboard, 100)
