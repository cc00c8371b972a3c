"""Whatever a program of a lab does wrong is one sentence, and nothing of the session or the answer is lost."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from own_robot import NAME, PUSHED, answer, printing, program, robot, run, runs

from adaptsim_cli.errors import AnswerRefused
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.store import SessionStore

LONG = [0.1 * i for i in range(12)]


LATE_S = float(PUSHED.observation.times_s[0]) + 1e-3


def rows(*row: float) -> list[list[float]]:
    return [list(row)] * 12


FAULTS: dict[str, tuple[str, str]] = {
    "exit code": ("raise SystemExit(3)", "ended with exit code 3"),
    "crash": ("raise RuntimeError('gripper lost')", "exit code 1: RuntimeError: gripper lost"),
    "killed": ("import os; os.kill(os.getpid(), 9)", r"exit code 137 \(killed by signal 9\)"),
    "nothing": ("pass", "ended without an output"),
    "blank": ("print()", "it is empty"),
    "no JSON": ("print('done')", "neither all of it nor its last line is JSON: 'done'"),
    "half": (f"print({json.dumps(answer())[:60]!r})", "neither all of it nor its last line is JSON"),
    "binary": ("import sys; sys.stdout.buffer.write(bytes(range(128, 256)))", r"not text in UTF-8 \(byte 0\)"),
    "too much": ("print('x' * 17_000_000)", "printed 16 MB, limit 16"),
    "a list": ("print([1, 2])", "a JSON list, and must be one object"),
    "deep": ("print('[' * 100_000)", "neither all of it nor its last line is JSON"),
    "NaN": (printing(answer(state=rows(float("nan"), 0.0, 0.0))), "state.*it must be a finite number"),
    "text for a number": (printing(answer(t_s=["0", *LONG[1:]])), "t_s"),
    "unknown key": (printing(answer(pose=1)), "pose"),
    "a reward": (printing(answer(reward=1.0)), "reward"),
    "no trial": (printing(answer(trial=None)), "trial"),
    "wrong trial": (printing(answer(trial=7)), "it answers trial 7, but trial 1 was asked for"),
    "newer": (printing(answer(adaptsim=2)), "adaptsim = 2: this version"),
    "nothing observed": (printing(answer(t_s=None, state=None)), "t_s and state are missing, and end too"),
    "no times": (printing(answer(t_s=None)), "t_s is missing"),
    "other length": (printing(answer(t_s=LONG[:-1])), "t_s has 11 times, and state has 12 rows"),
    "one state": (printing(answer(t_s=[0.0], state=[[0.68, 0.0, 0.0]])), "has 1 states, and needs two"),
    "ragged": (printing(answer(state=[*rows(0.68, 0.0, 0.0)[:-1], [0.68, 0.0]])), r"row 12 of state has 2 numbers"),
    "back in time": (printing(answer(t_s=[*LONG[:5], 0.3, *LONG[6:]])), "does not increase after 0.4 s"),
    "Unix times": (printing(answer(t_s=[1.7e9 + t for t in LONG])), "its first state is at 1.7e.09 s.*subtract"),
    "clock of the end": (printing(answer(t_s=[t - 1.5 for t in LONG])), "its first state is at -1.5 s"),
    "all before": (printing(answer(t_s=[0.3 * t - 0.4 for t in LONG])), "its last state is at -0.07 s"),
    "gap": (
        printing(answer(t_s=[0.0, *(t + 0.6 for t in LONG[1:])])),
        "after 0 s there is no state for 0.7 s, limit 0.5",
    ),
    "millimetres": (printing(answer(state=rows(680.0, 0.0, 20.0))), r"x \[m\] = 680 at 0 s, and toy expects"),
    "unknown outcome": (printing(answer(outcome="fell")), "outcome"),
    "foreign outcome": (printing(answer(outcome="tipped")), "outcome = tipped: a trial of toy ends as one of on_blade"),
    "no outcome": (printing(answer(outcome=None)), "outcome is missing: it must be one of on_blade, on_table"),
    "no end in the tool": (printing(answer(end_in_tool_m=None)), "add end_in_tool_m"),
    "short end": (printing(answer(t_s=None, state=None, end=[0.7])), "end has 1 numbers, and must have 3"),
    "both": (printing(answer(end=[0.7, 0.0, 0.0])), "it has a trajectory and an end"),
    "not at rest": (
        printing(answer(rest_s=0.0, state=[[0.6 + 0.02 * i, 0.0, 0.0] for i in range(12)])),
        "rest_s = 0, and after it the object moved by",
    ),
    "rest in milliseconds": (
        printing(answer(rest_s=1100.0)),
        r"rest_s = 1100, and the last state is at 1\.1 s: is rest_s in seconds",
    ),
    "a key twice": (
        f"print({json.dumps(answer())[:-1] + ', ' + json.dumps(answer(t_s=LONG[::-1]))[1:]!r})",
        "it has [a-z_]+ twice: leave one",
    ),
    "context unasked": (printing(answer(context={"x": 0.7})), "context was not asked for"),
    "no reason": (printing({"trial": 1, "rejected": " "}), "without a reason"),
    "two reasons": (printing({"trial": 1, "rejected": "a", "impossible": "b"}), "both rejected and impossible"),
}


def stored(home: Path) -> SessionStore:
    return SessionStore.open(home / "data/sessions", NAME)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_sentence_and_its_corrected_answer_counts(place: Path, fault: str) -> None:
    body, message = FAULTS[fault]
    home = place.parent / "home"
    failing = robot(place, f"open(RUNS, 'a').write('run\\n')\n{body}\n")
    with pytest.raises(AnswerRefused, match=message) as raised:
        run(home, program(failing))
    assert raised.value.__notes__ == [f"Continue with: adaptsim run-iteration --session {NAME}"]
    assert "\n" not in str(raised.value)
    assert runs(place) == ["run"]
    folder = stored(home).folder / "questions/trial-001-attempt-1"
    assert str(folder) in str(raised.value)
    (folder / "trial.answer.json").write_text(json.dumps(answer()))
    with pytest.raises(AnswerRefused, match="trial 2"):
        run(home, program(failing))
    (first,) = trials_of(stored(home))
    assert (first.trial, first.attempt, first.outcome) == (1, 1, "on_blade")
    assert runs(place) == ["run", "run"], "the corrected answer needs no second run"


def test_a_command_that_does_not_exist_says_so(place: Path) -> None:
    with pytest.raises(AnswerRefused, match=r"exit code 127 \(no such command\)"):
        run(place.parent / "home", program("no-such-robot --go"))


def test_an_old_answer_under_a_new_number_is_refused(place: Path) -> None:
    """A program that always prints the last trajectory it finds, whatever was asked."""
    stale = """
import json, sys
q = json.load(sys.stdin)
x, y = 0.68, 0.0
state = [[x + 0.02 * min(i, 8), y, 0.02] for i in range(12)]
print(json.dumps({"trial": q["trial"], "t_s": [0.1 * i for i in range(12)], "state": state, "outcome": "on_table"}))
"""
    with pytest.raises(AnswerRefused, match="it has the trajectory of trial 1, but its action differs"):
        run(place.parent / "home", program(robot(place, stale)))
    assert len(trials_of(stored(place.parent / "home"))) == 1


def test_a_deleted_answer_is_asked_for_again(place: Path) -> None:
    home, failing = place.parent / "home", robot(place, "open(RUNS, 'a').write('run\\n')\nprint('[]')")
    with pytest.raises(AnswerRefused, match="a JSON list"):
        run(home, program(failing))
    with pytest.raises(AnswerRefused, match="a JSON list"):
        run(home, program(failing))
    assert runs(place) == ["run"]
    (stored(home).folder / "questions/trial-001-attempt-1/trial.answer.json").unlink()
    done = run(home, program(robot(place)))
    assert runs(place)[1] == "trial 1.1"
    assert len(trials_of(done)) == 4


def test_what_is_rejected_is_made_again_and_what_is_impossible_is_never_asked_again(place: Path) -> None:
    refusing = """
import json, sys
q = json.load(sys.stdin)
open(RUNS, "a").write(json.dumps([q["trial"], q["attempt"], q["action"]]) + "\\n")
said = {1: {"rejected": "the table shook"}, 2: {}}
x, y = q["context"].values()
good = {"t_s": [0.0, 0.5, 1.0], "state": [[x, y, 0.0]] * 3, "outcome": "on_table"}
print(json.dumps({"trial": q["trial"], **(said[1] if q["trial"] == 1 and q["attempt"] == 1 else good)}))
"""
    done = run(place.parent / "home", program(robot(place, refusing)))
    made = [json.loads(line) for line in runs(place)]
    assert [one[:2] for one in made] == [[1, 1], [1, 2], [2, 1], [3, 1], [4, 1]]
    (change,) = done.rejections()
    assert "the table shook" in change.note.text


def test_an_end_alone_leaves_every_moment_missing_and_is_scored(place: Path) -> None:
    only_end = """
import json, sys
q = json.load(sys.stdin)
print(json.dumps({"trial": q["trial"], "end": [0.7, 0.0, 0.02], "outcome": "on_blade", "end_in_tool_m": [-0.02, 0, 0]}))
"""
    first, *_ = trials_of(run(place.parent / "home", program(robot(place, only_end))))
    assert set(first.observation) == {None}
    assert 0.0 <= first.reward <= 1.0
    assert any("only its end was observed" in flag for flag in first.track.flags)
    assert np.isnan(first.track.track().at(np.array([0.2]))).all()


def test_moments_before_the_first_state_are_missing(place: Path) -> None:
    late: dict[str, Any] = answer(t_s=[LATE_S + t for t in LONG], trial=None)
    body = f"import json, sys\nq = json.load(sys.stdin)\nprint(json.dumps({{**{late!r}, 'trial': q['trial']}}))"
    first, *_ = trials_of(run(place.parent / "home", program(robot(place, body))))
    missing = [value is None for value in first.observation]
    assert missing == sorted(missing, reverse=True)
    assert True in missing
    assert False in missing
