"""Rules around the loop of a session: when it ends, and that its report shows what is stored by then."""

from __future__ import annotations

from pathlib import Path

from toy_rig import ToyLab, opener
from toy_session import NAME, resolved

from adaptsim_cli.screen import views
from adaptsim_cli.session import running
from adaptsim_cli.session.ending import EndRule
from adaptsim_cli.session.flow import RunningSession
from adaptsim_cli.session.history import results_of, trials_of
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import page
from sim.adaptation.stages import Adapt, RunTrial, Show, Stage

EACH = 4
"""Trials of an iteration of the toy task: two of each of two particles."""


def run(home: Path, *rules: EndRule, iterations: int = 2) -> tuple[SessionStore, list[int]]:
    """A session with these rules, and how many trials each drawn report showed."""
    settings, drawn = resolved(home), list[int]()

    def draw(store: SessionStore) -> Path:
        drawn.append(len(trials_of(store)))
        return page.write(store)

    request = running.SessionRequest(None, frozenset({"task"}), iterations, yes=True, rules=rules)
    reply = running.run_session(settings, request, opener(ToyLab(0)), draw)
    store = SessionStore.open(settings.places.sessions, NAME)
    assert views.FileLine("Report", store.folder / "report.html") in reply.text
    return store, drawn


def after_trial(number: int) -> EndRule:
    return lambda session, stage: isinstance(stage, RunTrial) and stage.key.number == number


def test_a_rule_may_end_a_session_within_an_iteration_and_its_report_shows_the_trials_until_then(tmp_path):
    store, drawn = run(tmp_path, after_trial(EACH + 1))
    assert len(trials_of(store)) == EACH + 1 and drawn[-1] == EACH + 1
    assert len(results_of(store)) == 1 and store.existing().shown == {0}


def test_a_rule_may_end_a_session_before_its_first_result(tmp_path):
    store, drawn = run(tmp_path, after_trial(1))
    assert drawn == [1]
    assert results_of(store) == () and store.existing().shown == set()


def test_a_session_that_a_rule_ended_goes_on_with_its_next_trial(tmp_path):
    run(tmp_path, after_trial(2), iterations=1)
    store, drawn = run(tmp_path, iterations=1)
    assert len(trials_of(store)) == EACH and drawn == [EACH]
    assert store.existing().shown == {0}


def test_a_rule_hears_of_every_stage_once_it_is_stored(tmp_path):
    heard = list[tuple[type[Stage], int, int]]()

    def hears(session: RunningSession, stage: Stage) -> bool:
        heard.append((type(stage), len(trials_of(session.store)), len(results_of(session.store))))
        return False

    run(tmp_path, hears, iterations=1)
    trials = [(RunTrial, done, 0) for done in range(1, EACH + 1)]
    assert heard == [*trials, (Adapt, EACH, 1)], "its count ends the last one before other rules are asked"
    assert Show not in {kind for kind, _, _ in heard}
