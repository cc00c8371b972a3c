"""A person answers at the terminal; a program that moves a robot waits for one; nobody else's program runs unasked."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import pytest
from own_robot import NAME, PLACED, PUSHED, opener, program, robot, run, runs
from rich.console import Console
from toy_session import resolved

from adaptsim_cli import config
from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session import running
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.own.exchange import Answerer
from adaptsim_cli.session.own.person import TypedAnswers
from adaptsim_cli.session.own.program import Program
from adaptsim_cli.session.own.trust import require_trusted
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import page
from sim.tasks.task import Task


def screen_of(typed: str, monkeypatch: pytest.MonkeyPatch) -> tuple[Screen, io.StringIO]:
    """A terminal at which this is typed, and what it shows."""
    monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
    monkeypatch.setattr(console, "require_terminal", lambda *_: None)
    shown = io.StringIO()
    return Screen(console=Console(file=shown, width=200)), shown


def attended(home: Path, answerer: Answerer, screen: Screen, task: Task = PUSHED, *, yes: bool = False) -> SessionStore:
    settings = resolved(home, hw="own", answer_with="person")
    request = running.SessionRequest(None, frozenset({"task"}), 1, yes)
    running.run_session(settings, request, opener(answerer, task), page.write, screen)
    return SessionStore.open(settings.places.sessions, NAME)


def test_a_person_types_where_it_came_to_rest_and_a_bad_value_is_named_at_its_question(place, monkeypatch) -> None:
    first = ["y", "", "0,7", "0.7", "0.0", "0.02", "0.9", "fell", "1", "-0.02", "0", "0.01", ""]
    rest = ["y", "", "0.7", "0", "0.02", "", "2", ""] * 3
    screen, shown = screen_of("\n".join([*first, *rest]) + "\n", monkeypatch)
    done = attended(place.parent / "home", TypedAnswers(screen, PUSHED), screen)
    one, two, *_ = trials_of(done)
    assert (one.outcome, two.outcome) == ("on_blade", "on_table")
    assert one.track.state == ((0.7, 0.0, 0.02),)
    assert one.track.t_s == (0.9,)
    told = shown.getvalue()
    assert "0,7 is not a number; write it with a point" in told
    assert "fell is none of them" in told
    assert "You make this trial with your robot; adaptsim checks none of its motion" in told


def test_a_person_measures_the_place_first_and_names_a_file(place, monkeypatch) -> None:
    rows = "\n".join(f"{0.1 * i:.1f},0.68,0.0,0.02" for i in range(12))
    (place / "push.csv").write_text(f"t_s,x,y,z\n{rows}\n")
    (place / "bad.csv").write_text("t_s,x,y\n0,1,2\n")
    place_answers = ["9.0", "", "0.69", ""]
    trial = ["y", "nowhere.csv", "bad.csv", "push.csv", "2", ""]
    screen, shown = screen_of(
        "\n".join([*place_answers, *trial, *["", "", "y", "push.csv", "2", ""] * 3]) + "\n", monkeypatch
    )
    done = attended(place.parent / "home", TypedAnswers(screen, PLACED), screen, PLACED)
    first, *_ = trials_of(done)
    assert next(iter(first.context.values())) == 0.69
    told = shown.getvalue()
    assert "That cannot be: " in told
    assert "nowhere.csv: there is no such file" in told
    assert "bad.csv: it has no column 'z'" in told


def test_enter_starts_no_program_and_yes_none_that_moves(place, monkeypatch) -> None:
    screen, shown = screen_of("\n\nq\n", monkeypatch)
    moving = Program(robot(place), True, 20.0, screen, Release(screen, real=True))
    with pytest.raises(StoppedByOperator):
        attended(place.parent / "home", moving, screen, yes=True)
    assert runs(place) == []
    assert shown.getvalue().count("Enter alone means nothing here") == 2
    assert "It moves YOUR robot; adaptsim checks none of its motion" in " ".join(shown.getvalue().split())
    screen, _ = screen_of("y\n\n" * 4, monkeypatch)
    attended(place.parent / "home", Program(moving.command, True, 20.0, screen, Release(screen, real=True)), screen)
    assert runs(place) == [f"trial {n}.1" for n in range(1, 5)]


def test_a_moving_program_needs_a_terminal(place) -> None:
    with pytest.raises(UsageError, match="each motion of a real robot is confirmed at a terminal, also with --yes"):
        run(place.parent / "home", Program(robot(place), True, 20.0, None))
    assert runs(place) == []


def test_a_program_of_the_current_folder_runs_only_once_it_is_trusted(place, monkeypatch) -> None:
    robot(place)
    (place / "adaptsim.toml").write_text('hw = "own"\nanswer_with = "python robot.py"\nanswer_moves = "nothing"\n')
    settings = config.load()
    screen, _ = screen_of("\nq\n", monkeypatch)
    with pytest.raises(UsageError, match="counts only once a person has confirmed it"):
        require_trusted(settings, screen, yes=True)
    with pytest.raises(StoppedByOperator, match="nothing has run or moved"):
        require_trusted(settings, screen, yes=False)
    screen, shown = screen_of("y\n", monkeypatch)
    require_trusted(settings, screen, yes=False)
    assert "names the program `python robot.py`" in shown.getvalue()
    require_trusted(settings, screen, yes=True)
    (place / "robot.py").write_text("print('another one')")
    with pytest.raises(UsageError, match="counts only once a person has confirmed it"):
        require_trusted(settings, screen, yes=True)
    require_trusted(config.load({"answer_with": "python robot.py", "answer_moves": "nothing"}), screen, yes=True)


def test_a_session_changes_its_answerer_in_mid_course(place, monkeypatch) -> None:
    class Gone(BaseException):
        """Nobody answers any more."""

    def gone(_: float) -> None:
        raise Gone

    with pytest.raises(Gone):
        run(place.parent / "home", program("sh -c 'cat >/dev/null; sleep 0.2; exit 1'", pause=gone))
    screen, _ = screen_of(
        "\n".join(["", "0.7", "0", "0.02", "", "2", ""] + ["y", "", "0.7", "0", "0.02", "", "2", ""] * 3) + "\n",
        monkeypatch,
    )
    done = attended(place.parent / "home", TypedAnswers(screen, PUSHED), screen)
    assert [t.outcome for t in trials_of(done)] == ["on_table"] * 4
