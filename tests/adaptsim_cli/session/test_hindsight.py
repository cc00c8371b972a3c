"""Posterior, predictions and comparisons of stored sessions: the pendulum in its simulated target."""

from __future__ import annotations

import csv
import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from adaptsim_cli import config
from adaptsim_cli.commands import app
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.session.checkpoint import checkpoint_of_session
from adaptsim_cli.session.hindsight import Hindsight, believed
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import comparison, page
from adaptsim_cli.show.reports import Reports, measured_udr
from sim.adaptation import posterior as posteriors
from sim.errors import CheckpointError, CollapsedPosterior

pytestmark = pytest.mark.long

ADAPTED, UDR = "pendulum-wd", "pendulum-wd-udr"


@pytest.fixture(scope="module")
def root(tmp_path_factory) -> Path:
    """Two sessions of two iterations, made by the program."""
    home = tmp_path_factory.mktemp("hindsight")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ADAPTSIM_HOME", str(home))
        for method in ("adaptsim", "udr"):
            run = ["run-iteration", "--task", "pendulum", "--world", "wd", "--method", method, "-n", "2", "--yes"]
            assert app.run(run) == 0
    return home / "data" / "sessions"


@pytest.fixture(autouse=True)
def home(root: Path, monkeypatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(root.parents[1]))


def test_the_posterior_narrows_with_every_iteration(root):
    store = SessionStore.open(root, ADAPTED)
    found = Hindsight.of(store)
    effective = [found.posterior(store, i).effective for i in range(3)]
    assert effective[0] == pytest.approx(len(found.posterior(store, 0).samples))
    assert effective[1] < 0.1 * effective[0]
    assert found.posterior(store).weights.tolist() == found.posterior(store, 2).weights.tolist()


def test_the_simulator_prefers_the_adapted_policy_in_hindsight(root):
    judgement = Reports().judgement(SessionStore.open(root, ADAPTED))
    assert not isinstance(judgement, str)
    assert judgement.adapted.mean > judgement.first.mean
    assert sorted(judgement.predictions) == [1, 2, 3, 4]
    assert judgement.predictions[1].likely.shape[1:] == judgement.predictions[1].guess.shape


def test_the_page_shows_first_adapted_and_udr_with_posterior_and_predictions(root):
    html = Reports().draw(SessionStore.open(root, ADAPTED)).read_text()
    for row in ("First policies", "Best policy", "UDR"):
        assert f">{row}</text>" in html
    assert f"session {UDR}" in html, "the session of UDR in the same world is measured against"
    assert 'class="likely"' in html
    assert html.count("Predicted and observed curves") == 4
    numbers = [int(n) for n in re.findall(r"</i>Trial (\d+)", html)]
    assert numbers == [4, 3, 2, 1], "newest first"


def test_a_session_of_udr_is_not_its_own_reference(root):
    assert measured_udr(SessionStore.open(root, UDR)) is None
    reference = measured_udr(SessionStore.open(root, ADAPTED))
    assert (reference.session, len(reference.rewards)) == (UDR, 4)


def test_a_checkpoint_that_is_gone_is_named_and_the_page_is_drawn_without_it(root):
    store = SessionStore.open(root, ADAPTED)
    other = SessionStore(store.folder, store.facts.model_copy(update={"checkpoint_sha256": "f" * 64}), store.start)
    with pytest.raises(CheckpointError, match=r"pendulum/default \(ffffffffffff\).*ADAPTSIM_CHECKPOINT"):
        checkpoint_of_session(other)
    judgement = Reports().judgement(other)
    assert isinstance(judgement, str)
    html = page.render(other, judgement)
    assert "No posterior is drawn: session" in html
    assert 'class="likely"' not in html


def test_sessions_are_compared_by_session_method_and_trial(root, tmp_path):
    found = comparison.compared([SessionStore.open(root, name) for name in (ADAPTED, UDR)])
    path = comparison.write(found, tmp_path)
    html = path.read_text()
    assert html.count("<article") == 2
    assert "http" not in html
    sessions = list(csv.DictReader((tmp_path / comparison.SESSIONS).read_text().splitlines()))
    assert [row["method"] for row in sessions] == ["adaptsim", "udr"]
    rewards = [np.mean([t.reward for t in SessionStore.open(root, ADAPTED).trials(i)]) for i in (0, 1)]
    assert [float(sessions[0][f"{which}_reward"]) for which in ("first", "last")] == pytest.approx(rewards)
    trials = list(csv.DictReader((tmp_path / comparison.TRIALS).read_text().splitlines()))
    assert [(row["session"], row["iteration"], row["trial"]) for row in trials[:3]] == [
        (ADAPTED, "1", "1"),
        (ADAPTED, "1", "2"),
        (ADAPTED, "2", "3"),
    ]
    stored = SessionStore.open(root, ADAPTED).trials(0)[0]
    assert float(trials[0]["reward"]) == stored.reward
    assert float(trials[0]["action_k11"]) == stored.action["k11"]


def test_methods_are_paired_where_world_and_seed_agree(root):
    first, second = comparison.compared([SessionStore.open(root, name) for name in (ADAPTED, UDR)])

    def seed(session: comparison.ComparedSession, seed: int) -> comparison.ComparedSession:
        facts = session.facts.model_copy(update={"seed": seed})
        first = session.trials[0].model_copy(update={"reward": seed / 10})
        trials = (first, *session.trials[1:])
        return comparison.ComparedSession(facts, trials, session.result, session.iterations, session.table)

    rows = comparison.by_method([seed(s, n) for s in (first, second) for n in (0, 1)] + [seed(second, 7)])
    assert [(row.method, row.sessions) for row in rows] == [("adaptsim", 2), ("udr", 3)]
    assert rows[0].difference is None
    apart = rows[1]
    assert apart.pairs == 2
    assert apart.difference == pytest.approx(second.iterations[-1].mean - first.iterations[-1].mean)
    assert apart.difference_ci95[0] <= apart.difference <= apart.difference_ci95[1]


def test_sessions_that_repeat_each_other_are_named_and_count_as_one(root):
    first, second = comparison.compared([SessionStore.open(root, name) for name in (ADAPTED, UDR)])
    again = dataclasses.replace(first, facts=first.facts.model_copy(update={"name": "again", "seed": 1}))
    found = [first, again, second]
    assert comparison.identical(found) == ((ADAPTED, "again"),)
    assert comparison.repetitions(found) == (
        f"{ADAPTED} and again are identical, trial by trial: they count as one session.",
    )
    adapted, udr = comparison.by_method(found)
    assert (adapted.sessions, adapted.identical, adapted.last_ci95) == (1, 1, None)
    assert (udr.sessions, udr.identical) == (1, 0)
    html = comparison.render(found)
    assert "they count as one session" in html
    assert "1 (2 with repetitions)" in html


def test_a_collapsed_posterior_offers_no_interval_anywhere(root, monkeypatch):
    monkeypatch.setattr(posteriors, "RESOLVED", 1.0)  # as a grid that is too coarse to be tempered
    monkeypatch.setattr(posteriors, "LEAST_EFFECTIVE", 1e6)
    store = SessionStore.open(root, ADAPTED)
    beliefs = believed([store])
    assert {(one.low, one.median, one.high) for one in beliefs} == {(None, None, None)}
    told = "collapsed onto one sample: not an interval"
    assert comparison.within(beliefs[0]) == told
    assert comparison.disagreements(beliefs) == (f"The posterior of {ADAPTED} is {told}.",)
    with pytest.raises(CollapsedPosterior, match=told):
        Hindsight.of(store).posterior(store).quantiles((0.05, 0.95))
    html = page.render(store, Reports().judgement(store))
    assert told in html
    assert "90 % between" not in html


def test_what_cannot_be_compared_is_refused(root):
    store = SessionStore.open(root, ADAPTED)
    with pytest.raises(UsageError, match="two sessions or more"):
        comparison.compared([store])
    other = SessionStore(store.folder, store.facts.model_copy(update={"task": "scooping"}), store.start)
    with pytest.raises(UsageError, match="different tasks"):
        comparison.compared([store, other])
    with pytest.raises(SessionError, match="session"):
        SessionStore.open(config.load().places.sessions, "nothing")
