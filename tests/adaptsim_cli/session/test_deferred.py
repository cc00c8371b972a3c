"""Work beside the operator, and the report that is drawn there."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from toy_rig import ToyLab, opener
from toy_session import NAME, resolved, run

from adaptsim_cli.errors import SessionError
from adaptsim_cli.session import running
from adaptsim_cli.session.deferred import submit
from adaptsim_cli.session.history import results_of, trials_of
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import page

WAIT_S = 30.0  # no test waits so long unless it fails


def test_work_is_done_in_the_thread_or_by_whoever_needs_it_first():
    release = threading.Event()
    with ThreadPoolExecutor(1) as thread:
        first = submit(thread, lambda: release.wait(WAIT_S) and threading.current_thread())
        second = submit(thread, threading.current_thread)
        assert second.result() is threading.current_thread()
        release.set()
        assert first.result() is not threading.current_thread()
    done = list[str]()
    submit(None, lambda: done.append("dropped")).drop()
    submit(None, lambda: done.append("settled")).settle()
    assert done == []
    submit(None, lambda: done.append("needed")).result()
    assert done == ["needed"]


def test_an_error_reaches_whoever_asks_and_nobody_else():
    def failing() -> None:
        raise SessionError("no room")

    with ThreadPoolExecutor(1) as thread:
        ahead = submit(thread, failing)
        ahead.settle()
        for asked in (ahead.result, ahead.drop):
            with pytest.raises(SessionError, match="no room"):
                asked()


def test_a_report_shows_its_iterations_while_the_session_is_beyond_them(tmp_path):
    """The first drawing begins to read only after a trial of the second iteration was stored."""
    went_on, drawn = threading.Event(), list[list[int]]()

    def draw(store: SessionStore) -> Path:
        assert went_on.wait(WAIT_S), "the second iteration waited for the first report"
        drawn.append([trial.trial for trial in trials_of(store)])
        assert store.iterations() == len(results_of(store)) == len(drawn)
        return page.write(store)

    settings, request = resolved(tmp_path), running.SessionRequest(None, frozenset({"task"}), 2, yes=True)
    lab = ToyLab(0, {"place": lambda trial, attempt: went_on.set() if trial > 5 else None})
    running.run_session(settings, request, opener(lab), draw)
    store = SessionStore.open(settings.places.sessions, NAME)
    assert drawn == [[1, 2, 3, 4], [1, 2, 3, 4, 5, 6, 7, 8]], "the last one is drawn before the command ends"
    assert store.existing().shown == {0, 1}


def test_a_report_that_fails_stops_the_command_and_is_drawn_again_by_the_next_one(tmp_path):
    def full(store: SessionStore) -> Path:
        raise SessionError("the disk is full")

    settings, lab = resolved(tmp_path), ToyLab(0)
    request = running.SessionRequest(None, frozenset({"task"}), 1, yes=True)
    with pytest.raises(SessionError, match="the disk is full"):
        running.run_session(settings, request, opener(lab), full)
    store = run(tmp_path, lab)
    assert (store.iterations(), store.existing().shown) == (1, {0}), "the same iteration, shown again"
    assert (store.folder / "report.html").is_file()
