"""The dashboard: all sessions on one site, live while they run, and nothing else of the disk."""

from __future__ import annotations

import html
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest
from served_pages import Events, get
from toy_rig import TASK
from toy_session import NAME, run

from adaptsim_cli.screen.log import LogLine
from adaptsim_cli.session import keeping
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import dashboard, running_sessions, stored_page
from adaptsim_cli.show.dashboard import Dashboard
from adaptsim_cli.show.server import LocalServer
from adaptsim_cli.show.stored_page import StoredPage


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("dashboard")
    run(home, iterations=2)
    run(home, seed=1)
    return home


@pytest.fixture
def root(made: Path, place: Path) -> Path:
    shutil.copytree(made, place.parent / "home")
    return place.parent / "home/data/sessions"


@pytest.fixture
def site(root: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LocalServer]:
    monkeypatch.setattr(stored_page, "known_task", {"toy": TASK}.get)
    with LocalServer(Dashboard(root)) as served:
        yield served


def text(server: LocalServer) -> str:
    return get(server, "/")[2].decode()


def test_the_index_has_every_session_its_curve_and_its_tags(root: Path, site: LocalServer) -> None:
    keeping.mark(root, NAME, "#blade sharpened, #second-table")
    page = text(site)
    assert "<h1>2 sessions</h1>" in page and 'data-tags="blade second-table"' in page
    assert page.count('class="tag"') == 2 and "EventSource" in page
    curves = [json.loads(html.unescape(one.split('"')[0])) for one in page.split('data-curve="')[1:]]
    trials = trials_of(SessionStore.open(root, NAME))
    first = [trial.reward for trial in trials if trial.iteration == 1]
    assert [len(curve) for curve in curves] == [1, 2], "the newest session comes first"
    assert curves[1][0][:2] == [len(first), pytest.approx(sum(first) / len(first), abs=1e-4)]


def test_a_change_is_told_and_shown(root: Path, site: LocalServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dashboard, "POLL_S", 0.05)
    assert "#late" not in text(site)
    events = Events(site, "/changes")
    keeping.mark(root, NAME, "#late")
    assert events.next() == {}
    events.close()
    assert "#late" in text(site)


def test_reports_and_films_are_served_and_nothing_else_of_the_disk(root: Path, site: LocalServer) -> None:
    film = next((root / NAME).glob("iteration-*/trial-*/film.jpg"))
    status, head, content = get(site, f"/{film.relative_to(root)}")
    assert (status, head["Content-Type"], content) == (200, "image/jpeg", film.read_bytes())
    assert get(site, f"/{NAME}/report.html")[0] == 200
    (root / NAME / "out.html").symlink_to("/etc/hostname")
    (root.parent / "beside.html").write_text("beside")
    for path in ("session.toml", "out.html", "../beside.html", "..%2Fbeside.html", "../../../../etc/hostname", ""):
        assert get(site, f"/{NAME}/{path}")[0] == 404, path
    assert get(site, "/live/nobody/")[0] == get(site, f"/live/{NAME}")[0] == 404


def test_it_only_reads(root: Path, site: LocalServer) -> None:
    files = {path: path.stat().st_mtime_ns for path in root.rglob("*")}
    text(site), get(site, f"/live/{NAME}/")
    events = Events(site, f"/live/{NAME}/state")
    assert events.next()["rewards"] and events.next() is None
    events.close()
    assert {path: path.stat().st_mtime_ns for path in root.rglob("*")} == files


def test_a_session_that_another_process_runs_is_live(
    root: Path, site: LocalServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stored_page, "POLL_S", 0.05)
    store = SessionStore.open(root, NAME)
    assert running_sessions.running(root) == ()
    with store.locked():
        assert running_sessions.running(root) == (NAME,)
        assert f'Running now: <a href="live/{NAME}/">' in text(site)
        events = Events(site, f"/live/{NAME}/state")
        state = events.next()
        assert state["head"]["name"] == NAME and state["head"]["camera"] is False
        assert [one["number"] for one in state["rewards"]] == [trial.trial for trial in trials_of(store)]
        film = state["judged"]["film"]["url"].removeprefix("../..")
        assert get(site, film)[0] == 200
        line = LogLine(at="2026-01-01T10:00:00+00:00", event="asked", text="Is the work area clear?")
        with (store.folder / "log.jsonl").open("a") as log:
            log.write(line.model_dump_json() + "\n")
        assert events.next()["now"]["question"] == "Is the work area clear?"
    assert events.next() is None, "it says that the session has ended"
    events.close()
    assert "Running now" not in text(site)


def test_a_session_whose_task_is_gone_says_so(root: Path) -> None:
    state = StoredPage(root, NAME).state()
    assert state["now"]["doing"].startswith("The task toy cannot be loaded here")


def test_a_computer_without_a_list_of_locks_shows_nothing_as_running(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running_sessions, "LOCKS", root / "no-such-file")
    with SessionStore.open(root, NAME).locked():
        assert running_sessions.running(root) == ()


@pytest.mark.long
def test_the_command_serves_until_it_is_interrupted(root: Path) -> None:
    code = "from adaptsim_cli.commands.app import main; main()"
    line = [sys.executable, "-c", code, "dashboard", "--no-browser"]
    environment = {**os.environ, "COLUMNS": "200", "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split()[-1]
        with urlopen(address, timeout=30) as answer:
            assert b"2 sessions" in answer.read()
        process.send_signal(signal.SIGINT)
        said, wrong = process.communicate(timeout=60)
    assert (process.returncode, wrong) == (0, "")
    assert "No session was changed." in said
