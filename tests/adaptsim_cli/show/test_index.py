"""The page of all sessions."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from urllib.parse import unquote

import pytest
from toy_session import NAME, run

from adaptsim_cli.commands import app
from adaptsim_cli.session.advice import HEADLINES
from adaptsim_cli.session.history import results_of, trials_of
from adaptsim_cli.session.judgement import iteration_means
from adaptsim_cli.session.store import SessionStore


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("index")
    run(home, iterations=2)
    return home


@pytest.fixture
def root(made: Path, place: Path) -> Path:
    shutil.copytree(made, place.parent / "home")
    return place.parent / "home/data/sessions"


def test_every_session_is_on_the_page_with_links_to_its_report_and_film(root: Path, capfd) -> None:
    shutil.copytree(root / NAME, root / "a-copy")
    assert app.run(["sessions", "index", "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["sessions"] == 2
    text = Path(told["page"]).read_text()
    links = [unquote(link) for link in re.findall(r'<a href="([^"]+)"', text)]
    assert f"{NAME}/report.html" in links
    assert all((root / link).is_file() for link in links)
    assert any(link.endswith("film.jpg") for link in links)
    trials = [t.reward for t in trials_of(SessionStore.open(root, NAME)) if t.iteration == 2]
    assert f"{sum(trials) / len(trials):.2f}" in text
    verdict = results_of(SessionStore.open(root, NAME))[-1].verdict
    assert text.count(f'data-label="verdict">{HEADLINES[verdict.kind]}<') == 2
    assert 'data-label="95 % interval">–<' in text, "two sessions that earned the same have no interval"


def test_an_iteration_counts_once_it_is_complete(root: Path) -> None:
    store = SessionStore.open(root, NAME)
    trials = trials_of(store)
    whole = iteration_means(store.facts, trials)
    assert [mean.trials for mean in whole] == [len(trials) // 2] * 2
    assert iteration_means(store.facts, trials[:-1]) == whole[:1]
    assert [mean.trials for mean in iteration_means(store.facts, trials[:1])] == [1], "the only trials so far"


def test_a_damaged_session_is_named_and_hides_no_other(root: Path, capfd) -> None:
    (root / "broken").mkdir()
    (root / "broken/session.toml").write_text("half a fi")
    out = root.parent / "elsewhere/all.html"
    assert app.run(["sessions", "index", "--out", str(out)]) == 0
    assert "Sessions: 1" in capfd.readouterr().out
    text = out.read_text()
    assert "Not shown" in text
    assert "broken" in text
    assert f"file://{root / NAME / 'report.html'}" in text


def test_without_any_session_it_names_the_command_that_begins_one(place: Path, capfd) -> None:
    assert app.run(["sessions", "index"]) == 2
    assert "adaptsim run-iteration" in capfd.readouterr().err
