"""Every command about a session works for a session of every kind, also with `--json`, as its schema says."""

from __future__ import annotations

import io
import json
import shutil
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import toy_rig
from documents import every_command
from jsonschema import Draft202012Validator
from own_robot import PUSHED, opener, program, robot
from recordings import write_tables
from rich.console import Console
from toy_rig import PARAMETERS, ToyLab, ToyPolicy
from toy_session import ScriptedOperator, attended, resolved, run

from adaptsim_cli.commands import app
from adaptsim_cli.errors import AnswerAwaited
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.outputs import catalogue
from adaptsim_cli.session import beginning, opening, running
from adaptsim_cli.session.control import ControlPolicy
from adaptsim_cli.session.flow import RunningSession, run_iteration
from adaptsim_cli.session.folders import QUESTIONS, session_parts
from adaptsim_cli.session.keeping import verify
from adaptsim_cli.session.own.exchange import Answerer
from adaptsim_cli.session.own.mailbox import Mailbox
from adaptsim_cli.session.own.person import TypedAnswers
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import page
from sim.adaptation.method import Particle
from sim.tasks import TASKS

Make = Callable[[Path, pytest.MonkeyPatch], SessionStore]


def _lab(home: Path, _: pytest.MonkeyPatch) -> SessionStore:
    return run(home)


def _own(home: Path, answerer: Answerer, screen: Screen) -> SessionStore:
    settings = resolved(home, hw="own", answer_with="person")
    request = running.SessionRequest(None, frozenset({"task"}), 1, yes=False)
    running.run_session(settings, request, opener(answerer), page.write, screen)
    return SessionStore.open(settings.places.sessions, "toy-own")


def _screen(typed: str, monkeypatch: pytest.MonkeyPatch) -> Screen:
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    monkeypatch.setattr(console, "require_terminal", lambda *_: None)
    return Screen(console=Console(file=io.StringIO(), width=200))


def _program(home: Path, monkeypatch: pytest.MonkeyPatch) -> SessionStore:
    return _own(home, program(robot(home.parent)), _screen("y\n\n" * 4, monkeypatch))


def _person(home: Path, monkeypatch: pytest.MonkeyPatch) -> SessionStore:
    screen = _screen("\n".join(["y", "", "0.7", "0", "0.02", "", "2", ""] * 4) + "\n", monkeypatch)
    return _own(home, TypedAnswers(screen, PUSHED), screen)


def _python(home: Path, monkeypatch: pytest.MonkeyPatch) -> SessionStore:
    """Its first question is open."""
    settings = resolved(home, hw="own", answer_with="")
    root = settings.places.sessions
    with opener(Mailbox())(settings.config, root / "toy-own/naf") as parts:
        store = beginning.begin(root, "toy-own", settings.config, parts)
        session = RunningSession(store, parts, ScriptedOperator(), _screen("", monkeypatch))
        with pytest.raises(AnswerAwaited):
            run_iteration(session)
    return store


def _recorded(home: Path, _: pytest.MonkeyPatch) -> SessionStore:
    folder = write_tables(home.parent / "swings", 12)
    assert app.run(["run-iteration", "--task", "pendulum", "--recorded", str(folder), "--held-out", "0", "--yes"]) == 0
    return SessionStore.open(home / "data/sessions", "pendulum-swings")


def _controls() -> tuple[ControlPolicy, ...]:
    mean = PARAMETERS.middle
    return tuple(ControlPolicy(ToyPolicy(Particle(mean[None]), noise), mean) for noise in (-9.0, -8.0))


def _control(home: Path, _: pytest.MonkeyPatch) -> SessionStore:
    return run(home, kinds={"control": _controls}, iterations=2, control="udr")


def _rollout(home: Path, monkeypatch: pytest.MonkeyPatch) -> SessionStore:
    with monkeypatch.context() as patched:
        patched.setattr(opening, "open_parts", toy_rig.opener(ToyLab(0)))
        assert app.run(["rollout", "--task", "toy", "--yes", "--out", str(home / "data/sessions/one")]) == 0
    return SessionStore.open(home / "data/sessions", "one")


def _interrupted(home: Path, _: pytest.MonkeyPatch) -> SessionStore:
    def power_fails(_: object) -> None:
        raise KeyboardInterrupt

    session = attended(home, ScriptedOperator(before_motion=power_fails))
    with pytest.raises(KeyboardInterrupt):
        run_iteration(session)
    return session.store


def _pendulum(*more: str) -> Make:
    def make(home: Path, _: pytest.MonkeyPatch) -> SessionStore:
        line = ["run-iteration", "--task", "pendulum", "--world", "ood-1", "--session", "p", "-n", "2", "--yes", *more]
        assert app.run(line) == 0
        return SessionStore.open(home / "data/sessions", "p")

    return make


KINDS: dict[str, Make] = {
    "lab": _lab,
    "program": _program,
    "person": _person,
    "python": _python,
    "recorded": _recorded,
    "control": _control,
    "rollout": _rollout,
    "interrupted": _interrupted,
    "adaptsim": _pendulum(),
    "paper": _pendulum("--method", "adaptsim-iteration"),
    "udr": _pendulum("--method", "udr"),
    "bo": _pendulum("--method", "bo"),
    "paired": _pendulum("--control", "udr"),
}


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TASKS, "toy", toy_rig.__name__)


def keep_bundle_and_prune(store: SessionStore, kind: str, printed: Callable[..., dict[str, Any]]) -> None:
    """Nothing in the folder of a sound session, not even a folder of the user, is called damaged, before and after."""
    name = store.folder.name
    (store.folder / "notes of mine").mkdir()
    (verified,) = printed("sessions", "verify", name, "--json")["sessions"]
    assert verified["damage"] == []
    assert printed("sessions", "index", "--json")
    completed = store.existing().completed
    if completed:
        assert printed("sessions", "export", name, "--format", "csv", "--out", "trials.csv", "--json")["written"]
    assert printed("bundle", name, "--out", "all.zip", "--json")["files"]
    with zipfile.ZipFile("all.zip") as archive:
        inside = archive.namelist()
    assert any(QUESTIONS in file for file in inside) == (kind in ("program", "person", "python"))
    printed("sessions", "prune", name, "--yes", "--json")
    (again,) = printed("sessions", "verify", name, "--json")["sessions"]
    assert again["damage"] == []


def test_a_damaged_question_is_named_and_any_answer_is_not(place, monkeypatch) -> None:
    store = _person(place.parent / "home", monkeypatch)
    parts = session_parts(store.folder)
    assert parts.questions is not None and list(parts.iterations) == [0] and parts.others == ()
    folder, *_ = sorted(parts.questions.iterdir())
    before = verify(store.folder.parent, store.folder.name)
    assert before.damage == ()
    (folder / "trial.answer.json").write_text("anything")
    assert verify(store.folder.parent, store.folder.name).damage == ()
    question = folder / "trial.question.json"
    question.write_text(json.dumps({"ask": "trial"}))
    (damage,) = verify(store.folder.parent, store.folder.name).damage
    assert str(question) in damage and "session: field required" in damage
    shutil.rmtree(parts.questions)
    assert verify(store.folder.parent, store.folder.name).damage == ()


LINES = {
    "sessions show": ("NAME",),
    "sessions verify": ("NAME",),
    "sessions migrate": ("NAME",),
    "sessions mark": ("NAME", "--note", "before lunch"),
    "sessions list": (),
    "sessions index": (),
    "sessions policy": ("NAME",),
    "sessions export": ("NAME",),
    "report": ("NAME",),
    "compare": ("NAME", "other"),
    "bundle": ("NAME",),
    "retrack": ("NAME",),
    "replay": ("NAME", "1"),
    "rollout": ("--session", "NAME", "--best", "--yes"),
    "run-iteration": ("--session", "NAME", "--yes"),
    "sessions redo": ("NAME", "1", "--reason", "the object fell"),
    "sessions accept": ("NAME", "1", "--reason", "it had not"),
    "sessions amend": ("NAME", "1", "--outcome", "settled", "--reason", "seen"),
    "sessions prune": ("NAME", "--yes"),
    "sessions delete": ("NAME", "--yes"),
}
"""The commands about a session, in an order in which they can follow each other."""

NEVER_REFUSED = (
    "sessions show",
    "sessions verify",
    "sessions mark",
    "report",
    "bundle",
    "sessions prune",
    "sessions delete",
)
ADAPTED = *NEVER_REFUSED, "sessions policy", "sessions export", "compare", "rollout", "run-iteration"
"""What a session can do that has a checkpoint and two iterations."""


def test_every_command_about_a_session_is_in_the_walk() -> None:
    takes = {
        name.partition(" ")[2]
        for name, command in every_command()
        if {"session", "sessions", "name", "names"} & {p.name for p in command.params}
    }
    about = {name for name in takes if not name.startswith(("calibrate", "touch-off", "object"))}
    assert about <= set(LINES)


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=pytest.mark.slow if kind in ("bo", "udr") else pytest.mark.long) for kind in KINDS],
)
def test_every_command_about_a_session_prints_what_its_schema_says_or_refuses_in_a_sentence(
    kind, place, monkeypatch, capfd, printed
) -> None:
    store = KINDS[kind](place.parent / "home", monkeypatch)
    name = store.folder.name
    shutil.copytree(store.folder, store.folder.with_name("pruned"))
    keep_bundle_and_prune(SessionStore.open(store.folder.parent, "pruned"), kind, printed)
    shutil.rmtree(store.folder.with_name("pruned"))
    works: tuple[str, ...] = ADAPTED if store.facts.task == "pendulum" else NEVER_REFUSED
    if store.facts.recorded:  # no trial can be added to it
        works = tuple(command for command in works if command != "rollout")
    shutil.copytree(store.folder, store.folder.with_name("other"))
    for command, words in LINES.items():
        line = [*command.split(), *(name if word == "NAME" else word for word in words)]
        capfd.readouterr()
        code = app.run([*line, "--json"])
        out, err = capfd.readouterr()
        if code == 0:
            Draft202012Validator(catalogue.schema(command)).validate(json.loads(out))
        else:
            assert code in (2, 8) and out == "" and err.count("Error: ") == 1, (command, err)
            assert "corrupt" not in err, f"{command}: the session is sound"
            assert command not in works, (command, err)
