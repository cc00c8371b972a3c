"""The line that stands on a terminal while a command imports what it needs."""

from __future__ import annotations

import io
import sys

import pytest

from adaptsim_cli import app
from adaptsim_cli.screen import loading

ERASED = "\r\x1b[K"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def stderr_of(monkeypatch: pytest.MonkeyPatch, stderr: io.StringIO, *line: str, term: str = "xterm") -> str:
    monkeypatch.setenv("TERM", term)
    monkeypatch.setattr(sys, "stderr", stderr)
    app.run(line)
    return stderr.getvalue()


def test_it_comes_first_and_gives_way_to_what_is_said(monkeypatch):
    assert stderr_of(monkeypatch, Terminal(), "config", "path") == loading.LINE + ERASED
    refused = stderr_of(monkeypatch, Terminal(), "config", "nonsense")
    assert refused.startswith(loading.LINE + ERASED) and "nonsense" in refused


@pytest.mark.parametrize("line", [("--help",), ("config", "-h"), ("--version",)])
def test_it_is_not_shown_where_nothing_is_loaded(line, monkeypatch):
    assert stderr_of(monkeypatch, Terminal(), *line) == ""


def test_no_pipe_and_no_dumb_terminal_holds_it(monkeypatch):
    assert stderr_of(monkeypatch, io.StringIO(), "config", "path") == ""
    assert stderr_of(monkeypatch, Terminal(), "config", "path", term="dumb") == ""
