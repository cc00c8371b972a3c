"""Typing at a terminal of one's own."""

from __future__ import annotations

import io
import os
import pty
import threading

from rich.console import Console

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import enter, stop


def test_an_enter_typed_ahead_starts_nothing(monkeypatch):
    ours, theirs = pty.openpty()
    said = io.StringIO()
    screen = Screen(console=Console(file=said, width=80))
    os.write(ours, b"\n\n\n")
    threading.Timer(0.3, os.write, (ours, b"q\n")).start()
    with os.fdopen(theirs, encoding="utf-8") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        assert screen.choose("Is the work area clear?", enter("to start", "It moves."), stop("It ends.")) == "q"
    os.close(ours)
    assert said.getvalue().count("Is the work area clear?") == 1
