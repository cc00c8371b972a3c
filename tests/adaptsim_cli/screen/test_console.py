"""What a person reads and answers at the terminal."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from rich.console import Console
from rich.text import Text
from toy_rig import ToyLab, flange
from toy_session import ScriptedOperator, attended

from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen import console, views
from adaptsim_cli.screen.clean_console import CleanConsole, clean
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.release import Release
from adaptsim_cli.screen.views import between, clear_to_move, predicted_between, top_speed_m_s
from adaptsim_cli.session.flow import run_iteration
from adaptsim_cli.session.live_trial import PlannedTrial
from adaptsim_cli.session.operator import Attended
from adaptsim_cli.session.records import MotionRecord
from hw.errors import ArmFault
from hw.types import JointPath
from perception.types import Outcome


class Keyboard(io.StringIO):
    """Echoes the Enter of every answer, as a terminal does."""

    def __init__(self, answers: tuple[str, ...], echo: io.StringIO) -> None:
        super().__init__("".join(f"{answer}\n" for answer in answers))
        self._echo = echo

    def readline(self, *size: int) -> str:  # type: ignore[override]
        self._echo.write("\n")
        return super().readline(*size)


def answering(monkeypatch: pytest.MonkeyPatch, *answers: str, width: int = 80) -> tuple[Attended, io.StringIO]:
    said = io.StringIO()
    monkeypatch.setattr("sys.stdin", Keyboard(answers, said))
    return Attended(Screen(console=Console(file=said, width=width, highlight=False, markup=False))), said


def test_a_key_releases_each_trial_of_an_iteration(tmp_path, monkeypatch):
    operator, said = answering(monkeypatch, *["", "y", ""] * 4)
    session = attended(tmp_path, operator)
    object.__setattr__(session, "screen", operator.screen)
    run_iteration(session)
    text = said.getvalue()
    assert text.index("The task policy was trained for") < text.index("Predicted reward") < text.index("Tracked:")
    assert " ".join(text.split()).count("the tool at up to 0.00 m/s. Type y to start, q to stop, ? explains:") == 4
    assert "What changed" in text


def test_enter_alone_moves_nothing(tmp_path, monkeypatch):
    lab = ToyLab(0)
    operator, said = answering(monkeypatch, *[""] * 30)
    with pytest.raises(StoppedByOperator):
        run_iteration(attended(tmp_path, operator, lab))
    assert lab.executions == []
    assert "Enter alone means nothing here, and nothing has happened." in " ".join(said.getvalue().split())


@pytest.mark.parametrize("answers", [("q",), ("", "q"), ("", "y", "q"), ()])
def test_q_or_the_end_of_input_stops_at_every_question(answers, tmp_path, monkeypatch):
    lab = ToyLab(0)
    operator, _ = answering(monkeypatch, *answers)
    with pytest.raises(StoppedByOperator) as stopped:
        run_iteration(attended(tmp_path, operator, lab))
    at_review = len(answers) == 3
    assert len(lab.executions) == (1 if at_review else 0)
    assert ("asks for its review again" in str(stopped.value)) == at_review


def test_an_unknown_key_says_so_and_a_question_mark_explains(tmp_path, monkeypatch):
    lab = ToyLab(0)
    operator, said = answering(monkeypatch, "go", "?", "q", width=200)
    with pytest.raises(StoppedByOperator):
        run_iteration(attended(tmp_path, operator, lab))
    assert "go means nothing here, and nothing has happened." in said.getvalue()
    assert re.search(r"q +The command ends; everything completed is stored\.", said.getvalue())
    assert "Nothing moves yet." in said.getvalue()
    assert lab.executions == []


def test_what_q_promises_is_what_it_then_says(monkeypatch):
    operator, said = answering(monkeypatch, "?", "q")
    with pytest.raises(StoppedByOperator, match="stopped by the operator; nothing was stored"):
        operator.screen.go_on("Is the hand empty?", then="The hand opens.", assurance="nothing was stored")
    assert "The command ends; nothing was stored." in said.getvalue()


def test_a_rejection_begun_by_mistake_is_left_without_a_trace(tmp_path, monkeypatch):
    """`r`, then second thoughts; then the list of outcomes, and second thoughts again."""
    operator, said = answering(monkeypatch, "", "y", "r", "q", "o", "q", "", "q")
    session = attended(tmp_path, operator)
    with pytest.raises(StoppedByOperator):
        run_iteration(session)
    assert session.store.existing().rejected == frozenset()
    assert len(session.store.trials(0)) == 1
    assert said.getvalue().count("Is this what you saw?") == 3


def test_overruling_offers_the_outcomes_that_the_track_supports(tmp_path, monkeypatch):
    operator, said = answering(monkeypatch, "", "y", "o", "9", "o", "2", "q")
    session = attended(tmp_path, operator)
    with pytest.raises(StoppedByOperator):
        run_iteration(session)
    assert session.store.trials(0)[0].outcome is Outcome.ON_TABLE
    assert "1  on blade (reward 0.9" in said.getvalue()


def test_a_redo_asks_why(tmp_path, monkeypatch):
    operator, said = answering(monkeypatch, "", "y", "r", "?", "a hand was in the way", "q")
    session = attended(tmp_path, operator)
    object.__setattr__(session, "screen", operator.screen)
    with pytest.raises(StoppedByOperator):
        run_iteration(session)
    assert "attempt 1, does not count: a hand was in the way" in said.getvalue(), "? is no reason"


@pytest.mark.parametrize("width", [80, 50, 40])
def test_nothing_runs_past_a_narrow_screen(width, tmp_path, monkeypatch):
    operator, said = answering(monkeypatch, *["", "y", ""] * 4, width=width)
    session = attended(tmp_path, operator)
    object.__setattr__(session, "screen", operator.screen)
    run_iteration(session)
    lines = [line for line in said.getvalue().splitlines() if ".jpg" not in line]  # paths stay whole
    assert max(len(line.rstrip()) for line in lines) <= width
    table = said.getvalue()[said.getvalue().index("What changed") :]
    assert "e [kPa]" in table, "brackets are not taken for markup"
    assert table.count("particle 1") == 1


def test_an_error_is_one_line_that_can_be_copied(capfd):
    console.error("something long " * 20 + "\nContinue with: adaptsim run-iteration --session a[b]")
    assert capfd.readouterr().err.splitlines()[-1] == "Continue with: adaptsim run-iteration --session a[b]"


def test_escape_sequences_never_reach_the_terminal():
    told = io.StringIO()
    screen = Screen(console=CleanConsole(file=told, width=200))
    for text in ("\x1b[2Jgone", "\x9b31m", "back\rwards", "bell\x07", "\x1b]0;title\x07"):
        screen.plain(text)
        screen.note(text)
        screen.show(Text(text))
    assert not any(one in told.getvalue() for one in "\x1b\x9b\r\x07")
    assert "\\x1b[2Jgone" in told.getvalue()
    assert clean("plain ° text\n") == "plain ° text\n"


def test_it_says_who_does_what_how_long_and_how_fast():
    text = clear_to_move(True, "scoops and goes back", 11.6, 0.804)
    assert text == (
        "Is the work area clear, nobody within reach? THE REAL ROBOT then scoops and goes back: 12 s in all, "
        "the tool at up to 0.80 m/s"
    )
    assert clear_to_move(False, "goes home").endswith("The simulated robot then goes home")


def test_the_speed_is_the_largest_of_all_paths():
    def along(duration_s: float) -> JointPath:
        t_s = np.linspace(0.0, duration_s, round(1000 * duration_s) + 1)
        u = t_s / duration_s
        q_rad = np.zeros((len(t_s), 7))
        q_rad[:, 0] = u**2 * (3.0 - 2.0 * u)  # the toy's first joint is metres along X: 1 m, fastest in the middle
        return JointPath(t_s, q_rad)

    assert top_speed_m_s([along(4.0), along(2.0), along(8.0)], flange) == pytest.approx(1.5 / 2.0, rel=1e-3)


@pytest.mark.parametrize("name", ["fake", "panda"])
def test_it_is_asked_after_every_placing_and_before_anything_moves(name, tmp_path):
    events: list[str] = []

    class Person(ScriptedOperator):
        def placed(self, what: str, wanted_m: np.ndarray, real: bool) -> None:
            events.append("placed")

        def approve(self, trial: MotionRecord, planned: PlannedTrial, real: bool, release: Release) -> None:
            who = "THE REAL ROBOT" if real else "The simulated robot"
            assert planned.announcement.startswith(
                f"Is the work area clear, nobody within reach? {who} then comes to the"
            )
            events.append("clear")

    def reflex(trial: int, attempt: int) -> None:
        events.append("moves")
        if (trial, attempt) == (2, 0):
            raise ArmFault("reflex")

    lab = ToyLab(0, hooks={"execute": reflex}, misplaced=frozenset({(3, 0)}))
    with pytest.raises(ArmFault):
        run_iteration(attended(tmp_path, Person(), lab, name))
    run_iteration(attended(tmp_path, Person(), lab, name))
    trial = ["placed", "clear", "moves", "moves", "moves"]
    failed, misplaced = ["placed", "clear", "moves"], ["placed"]
    assert events == [*trial, *failed, *trial, *misplaced, *trial, *trial]


@pytest.mark.parametrize(("name", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_no_colour_where_none_is_wanted(name: str, value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, value)
    said = io.StringIO()
    screen = Screen(console=Console(file=said, force_terminal=True, width=60, markup=False))
    screen.note("careful")
    with screen.busy("working"):
        pass
    assert "\x1b[3" not in said.getvalue()


def test_progress_off_a_terminal_is_a_line_a_tenth() -> None:
    said = io.StringIO()
    with Screen(console=Console(file=said, width=60)).progress() as update:
        for done in range(1001):
            update("dataset", done, 1000)
    lines = said.getvalue().splitlines()
    assert len(lines) == 11
    assert lines[-1].strip() == "dataset: 100 % (1000 of 1000)"


def test_an_interval_without_a_width_is_a_dash_with_the_reason():
    assert between(0.68, 0.96) == "0.68 to 0.96"
    assert between(-0.1, 0.2, "+.2f") == "−0.10 to +0.20"
    assert between(0.961, 0.964) == "–"
    assert predicted_between(0.96, 0.96) == "–: all simulators that may be true predict the same"


def test_signs_are_true_ones_and_a_zero_has_none() -> None:
    assert [views.signed(x) for x in (-0.514, 0.02, -0.001, 0.0)] == ["−0.51", "+0.02", "0.00", "0.00"]
    said = "lies -0.0 mm from its place, -0.8 to +0.0 mm, depth-3 by -12 px (+0.05)"
    assert views.with_signs(said) == "lies 0.0 mm from its place, −0.8 to 0.0 mm, depth-3 by −12 px (+0.05)"
