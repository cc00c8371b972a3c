"""What loggers get of a session, while it runs and afterwards; TensorBoard's by its real package, without a network."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from documents import install
from real_lab import said
from toy_rig import ToyLab, opener
from toy_session import NAME, resolved, run, silent

import adaptsim
from adaptsim_cli.commands import app
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session import running
from adaptsim_cli.session.history import played_of, results_of
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import page
from adaptsim_cli.show.loggers import LOGGERS, OURS
from adaptsim_cli.show.loggers.feed import logged_again, with_loggers
from hw import plugins
from sim.errors import ExtraMissing

LOGBOOK = """
KEPT = []

class Book:
    opened_by = "read book"
    def __init__(self, session): self.session = session
    def values(self, step, values): KEPT.append(("values", step, dict(values)))
    def words(self, step, name, text): KEPT.append(("words", step, name, text))
    def picture(self, step, name, jpeg): KEPT.append(("picture", step, name, jpeg[:2]))
    def close(self): KEPT.append(("closed", self.session))

class Torn(Book):
    def values(self, step, values): raise RuntimeError("no pages left")

def open_logger(folder, session, settings):
    KEPT.append(("opened", folder.name, settings["task"], list(folder.iterdir())))
    return Book(session)

def open_torn(folder, session, settings):
    return Torn(session)
"""


@pytest.fixture
def logbook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """A package that offers two loggers; what the first one kept."""
    (tmp_path / "logbook.py").write_text(LOGBOOK, encoding="utf-8")
    install(tmp_path, "logbook", {"book": "logbook", "torn": "logbook:open_torn"}, LOGGERS.group)
    monkeypatch.syspath_prepend(tmp_path)
    plugins.offers.cache_clear()
    import logbook  # type: ignore[import-not-found]  # noqa: PLC0415 - it exists from here on

    yield logbook.KEPT
    plugins.offers.cache_clear()
    sys.modules.pop("logbook", None)


def logged_run(home: Path, *names: str, iterations: int = 1) -> tuple[SessionStore, str]:
    """A session on the toy rig with these loggers, and what its screen said."""
    settings, screen = resolved(home), silent()
    request = running.SessionRequest(None, frozenset({"task"}), iterations, yes=True)
    view = with_loggers(names, settings.places.logs, running.terminal_alone)
    running.run_session(settings, request, opener(ToyLab(0)), page.write, screen, view)
    return SessionStore.open(settings.places.sessions, NAME), said(screen)


def test_a_logger_of_a_package_gets_reward_parameters_verdict_and_pictures(logbook: list[Any], place: Path) -> None:
    store, text = logged_run(place.parent / "home", "book")
    assert re.search(r"Log for book: .*; open it with `read book`", " ".join(text.split()))
    assert logbook[0] == ("opened", NAME, "toy", []) and logbook[-1] == ("closed", NAME)
    trials, (result,) = played_of(store), results_of(store)
    values = [one[1:] for one in logbook if one[0] == "values"]
    assert [step for step, _ in values] == [1, 2, 3, 4, 4]
    for trial, (_, kept) in zip(trials, values, strict=False):
        assert kept["reward"] == trial.reward and kept["predicted_reward"] == trial.predicted_reward
        assert {name: kept[f"parameter/{name}"] for name in trial.parameters} == trial.parameters
        assert {name: kept[f"action/{name}"] for name in trial.action} == trial.action
    assert values[-1][1]["best/reward"] == result.best.mean_reward
    (verdict,) = [one[3] for one in logbook if one[:3] == ("words", 4, "verdict")]
    assert verdict == adaptsim.open_session(NAME).verdict
    assert {one[2] for one in logbook if one[0] == "picture"} >= {"film"}
    assert {one[3] for one in logbook if one[0] == "picture"} == {b"\xff\xd8"}


def test_each_trial_is_kept_once_and_a_further_command_begins_the_log_anew(logbook: list[Any], place: Path) -> None:
    logged_run(place.parent / "home", "book")
    first = [one[1] for one in logbook if one[0] == "words" and one[2] == "outcome"]
    logbook.clear()
    logged_run(place.parent / "home", "book")
    again = [one[1] for one in logbook if one[0] == "words" and one[2] == "outcome"]
    assert (first, again) == ([1, 2, 3, 4], [1, 2, 3, 4, 5, 6, 7, 8])


def test_a_logger_that_fails_ends_and_the_session_goes_on(logbook: list[Any], place: Path) -> None:
    store, text = logged_run(place.parent / "home", "torn", "book")
    assert len(played_of(store)) == 4
    assert text.count("The log for torn ends here, and the session goes on: no pages left") == 1
    assert [one for one in logbook if one[0] == "values"]


def test_an_unknown_logger_is_refused_before_anything_begins(place: Path, refused: Any) -> None:
    with pytest.raises(UsageError, match=r'logger "tensorbord" is not known: .*; did you mean tensorboard\?'):
        with_loggers(["tensorbord"], place, running.terminal_alone)
    line = ("run-iteration", "--task", "pendulum", "--yes", "--log", "tensorbord")
    assert "did you mean tensorboard" in refused(2, *line)
    assert app.run(["sessions", "list", "--json"]) == 0 and not (place.parent / "home/data/sessions").exists()


@pytest.mark.parametrize("name", list(OURS))
def test_a_missing_package_is_one_sentence(name: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = {"tensorboard": "tensorboardX"}.get(name, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ExtraMissing, match=rf"needs the package {package}, which is not installed: .*\[{name}\]"):
        LOGGERS.get(name)(place, "s", {})


def test_tensorboard_reads_what_a_stored_session_gave_it(place: Path) -> None:
    from tensorboardX.proto.event_pb2 import Event  # noqa: PLC0415 - slow to import

    home = place.parent / "home"
    store = run(home)
    folder = logged_again("tensorboard", resolved(home).places.logs, store)
    (file,) = folder.iterdir()
    scalars, texts, pictures = list[tuple[str, int, float]](), dict[str, str](), set[str]()
    for content in records(file.read_bytes()):
        event = Event.FromString(content)
        for value in event.summary.value:
            if value.HasField("simple_value"):
                scalars.append((value.tag, event.step, value.simple_value))
            elif value.HasField("image"):
                pictures.add(value.tag)
            else:
                texts[value.tag] = value.tensor.string_val[0].decode()
    rewards = [(step, value) for tag, step, value in scalars if tag == "reward"]
    assert rewards == [(one.trial, pytest.approx(one.reward)) for one in played_of(store)]
    assert adaptsim.open_session(NAME).verdict in texts.values()
    assert any("film" in tag for tag in pictures)


def records(content: bytes) -> Iterator[bytes]:
    """The records of an event file: length (8), its checksum (4), content, its checksum (4)."""
    at = 0
    while at < len(content):
        size = int.from_bytes(content[at : at + 8], "little")
        yield content[at + 12 : at + 12 + size]
        at += size + 16
