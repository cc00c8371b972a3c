"""The first trial of a robot of one's own is drawn over the predicted ones; a full disk costs the page alone."""

from __future__ import annotations

import io
from typing import Any

import pytest
from rich.console import Console

from adaptsim_cli import api
from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.checkpoint import checkpoint_of_session
from adaptsim_cli.show.first_look import PAGE, FirstLook, ReportedEnd, _Looking


@pytest.mark.parametrize(("reported", "is_outside"), [(0.7, False), (0.55, False), (0.45, True), (0.95, True)])
def test_an_end_is_outside_beyond_the_margin_of_the_predicted_ones(reported, is_outside):
    end = ReportedEnd("x", "m", reported, low=0.6, high=0.8, margin=0.1)
    assert end.is_outside is is_outside
    assert end.in_words == f"x {reported:.3f} m (predicted 0.600 m to 0.800 m)"


@pytest.mark.long
def test_the_first_trial_alone_is_drawn_and_a_page_that_cannot_be_written_is_only_noted(monkeypatch):
    session = api.begin("pushing", hw="own", name="mine")
    for _ in range(2):
        trial = session.ask()
        session.tell(trial, end=[0.75, 0.0, 0.035], outcome="upright")
    page = session.folder / PAGE
    first, second = session.trials
    assert page.read_text(encoding="utf-8").count('class="later"') == 64
    shown = io.StringIO()
    screen = Screen(console=Console(file=shown, width=200))
    looking = _Looking(screen, session._stored, checkpoint_of_session(session._stored).solver)
    tracked: Any = None  # only the record is drawn
    looking.tracked(second, tracked)
    assert shown.getvalue() == ""
    looking.tracked(first, tracked)
    assert "Is this your table?" in shown.getvalue()

    def full(*_: object) -> None:
        raise SessionError("the disk is full")

    monkeypatch.setattr(FirstLook, "write", full)
    looking.tracked(first, tracked)
    assert "is not drawn over the predicted ones: the disk is full" in shown.getvalue()
