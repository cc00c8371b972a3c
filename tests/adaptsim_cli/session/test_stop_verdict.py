"""Where the verdict says stop, a terminal asks, `--until-done` ends, and `--yes` says once how it could end."""

from __future__ import annotations

from pathlib import Path

import pytest
from real_lab import quiet, said
from toy_rig import ToyLab, opener
from toy_session import NAME, resolved

from adaptsim_cli.screen import console
from adaptsim_cli.session import running
from adaptsim_cli.session.history import results_of
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import page

ASKED = "The verdict says stop. Run another iteration?"


def run(home: Path, *, yes: bool = True, until_done: bool = False) -> tuple[SessionStore, str]:
    """A session of up to three iterations, whose first verdict says stop, and its screen."""
    settings, screen = resolved(home), quiet()
    request = running.SessionRequest(None, frozenset({"task"}), 3, yes, until_done)
    running.run_session(settings, request, opener(ToyLab(settings.config.seed)), page.write, screen)
    return SessionStore.open(settings.places.sessions, NAME), said(screen)


def test_unattended_it_runs_on_and_says_why_after_each_verdict_that_it_passes(tmp_path):
    store, shown = run(tmp_path)
    stops = [result.verdict.stops for result in results_of(store)]
    assert len(stops) == 3 and stops[0]
    passed = sum(stops[:-1])
    assert shown.count("The session goes on, because this command was given --iterations 3") == passed > 0
    assert shown.count("--until-done") == passed


def test_until_done_ends_there(tmp_path):
    store, shown = run(tmp_path, until_done=True)
    assert [result.verdict.stops for result in results_of(store)] == [True]
    assert "says stop" not in shown


@pytest.mark.parametrize(("answers", "iterations"), [(["n", ""], 1), (["y", ""], 2)])
def test_a_terminal_asks_and_enter_ends_the_command(tmp_path, monkeypatch, answers, iterations):
    monkeypatch.setattr(console, "require_terminal", lambda *_: None)
    script, asked = iter(answers), list[str]()

    def answer(self: console.Screen, question: str) -> str:
        if not question.startswith(ASKED):
            return "y" if "y to start" in question else ""  # lets the arm move, and accepts every trial
        asked.append(question)
        return next(script)

    monkeypatch.setattr(console.Screen, "ask", answer)
    store, _ = run(tmp_path, yes=False)
    assert len(results_of(store)) == iterations
    assert len(asked) == 2
