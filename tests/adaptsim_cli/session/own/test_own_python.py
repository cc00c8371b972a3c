"""Ask and tell from Python, and the same numbers as the simulated lab where a program computes the same world."""

from __future__ import annotations

import json
import re
import shlex
import sys

import numpy as np
import pytest
from documents import FENCE, ROOT

from adaptsim_cli import api
from adaptsim_cli.commands import app
from adaptsim_cli.errors import AnswerRefused, UsageError
from sim.lab.rollout import rollout_in
from sim.lab.world import load_world
from sim.tasks import get_task

MU = 0.12
WORLD = "mujoco-wd"


def pushed(trial: api.Question) -> tuple[list[float], list[list[float]]]:
    """Times and states of a bottle that slides on a table of one friction."""
    assert trial.action is not None
    yaw, speed = trial.action["yaw"], trial.action["speed"]
    stop_s = speed / (9.81 * MU)
    times = [0.05 * i for i in range(40)]
    ways = [speed * min(t, stop_s) - 0.5 * 9.81 * MU * min(t, stop_s) ** 2 for t in times]
    return times, [[0.56 + way * float(np.cos(yaw)), way * float(np.sin(yaw)), 0.035] for way in ways]


@pytest.mark.long
def test_trials_are_asked_and_told_in_any_order_and_the_session_adapts() -> None:
    session = api.begin("pushing", hw="own", name="lab")
    trials = session.asks()
    assert [trial.trial for trial in trials] == [1, 2, 3, 4]
    assert session.ask() == trials[0]
    with pytest.raises(AnswerRefused, match="outcome = on_blade: a trial of pushing ends as one of upright, tipped"):
        session.tell(trials[0], *pushed(trials[0]), "on_blade")
    assert session.ask() == trials[0], "a refused answer is not kept"
    session.tell(trials[2], *pushed(trials[2]), "upright")
    assert [trial.trial for trial in session.trials] == [3]
    assert [trial.trial for trial in session.asks()] == [1, 2, 4]
    with pytest.raises(UsageError, match="trial 3 is not open"):
        session.tell(trials[2], *pushed(trials[2]), "upright")
    session.tell(trials[0], rejected="the bottle fell before the push")
    again = session.ask()
    assert (again.trial, again.attempt) == (1, 2)
    session.tell(again, *pushed(again), "upright")
    session.tell(trials[1], end=[0.8, 0.0, 0.035], outcome="upright")
    assert [iteration.number for iteration in session.iterations] == []
    session.tell(trials[3], impossible="beyond my table")
    other = session.ask()
    assert (other.trial, other.attempt) == (4, 2)
    apart = np.abs(np.array(list((other.action or {}).values())) - list((trials[3].action or {}).values()))
    assert (apart > 0.0).any()
    session.tell(other, *pushed(other), "upright", note="the last one")
    assert [iteration.number for iteration in session.iterations] == [1]
    assert [trial.trial for trial in session.trials] == [1, 2, 3, 4]
    assert [trial.trial for trial in session.asks()] == [5, 6, 7, 8]


def test_only_a_session_with_a_robot_of_ones_own_asks() -> None:
    session = api.begin("pendulum", name="lab")
    with pytest.raises(UsageError, match="it makes its trials itself: call run"):
        session.ask()
    with pytest.raises(UsageError, match="hw = panda: Python begins sessions in the simulated lab, or with hw = own"):
        api.begin("pushing", hw="panda")


def test_a_task_that_no_lab_can_report_says_so(refused) -> None:
    line = ("run-iteration", "--task", "pendulum", "--hw", "own", "--answer-with", "person")
    message = refused(2, *line, "--yes")
    assert "the task pendulum does not fit a robot of your own: its reward needs excess cost" in message


@pytest.mark.parametrize(
    "line",
    [
        ("calibrate", "--hw", "own", "--yes"),
        ("touch-off", "--task", "scooping", "--hw", "own", "--yes"),
        ("touch-off", "--task", "scooping", "--hw", "own"),
        ("preview", "--task", "pushing", "--hw", "own"),
        ("setup", "--hw", "own"),
    ],
)
def test_commands_of_a_rig_say_that_the_robot_belongs_to_other_code_and_what_runs_its_trials(refused, line) -> None:
    message = refused(2, *line)
    assert "hw = own: your robot belongs to your code" in message
    assert "adaptsim run-iteration --hw own" in message


def test_the_doctor_checks_the_program_alone(printed) -> None:
    findings = printed("doctor", "--hw", "own", "--task", "pushing", "--json")["checks"]
    verdicts = {finding["name"]: finding["verdict"] for finding in findings}
    assert verdicts["checkpoint"] == "ok"
    assert {verdicts[name] for name in ("driver", "rig file", "camera", "calibration", "motion")} == {"skipped"}


PROGRAM = """
import json, math, sys
q = json.load(sys.stdin)
yaw, speed = q["action"]["yaw"], q["action"]["speed"]
ways = [speed * (s - s * s / 2) for s in (min(t / 20, 1.0) for t in range(40))]
state = [[0.56 + way * math.cos(yaw), way * math.sin(yaw), 0.035] for way in ways]
print(json.dumps({"trial": q["trial"], "t_s": [t / 20 for t in range(40)], "state": state, "outcome": "upright"}))
"""


@pytest.fixture
def answers(place) -> tuple[str, ...]:
    (place / "robot.py").write_text(PROGRAM)
    command = f"{shlex.quote(sys.executable)} -S -E {shlex.quote(str(place / 'robot.py'))}"
    return ("--hw", "own", "--answer-with", command)


def test_a_rollout_asks_the_robot_once_and_is_stored_as_any_session(printed, refused, answers) -> None:
    rollout = ("rollout", "--task", "pushing", "--action", "speed=0.6", *answers, "--yes")
    assert "confirmed at a terminal" in refused(2, *rollout), "it moves a robot unless it says that it does not"
    told = printed(*rollout, "--answer-moves", "nothing", "--json")
    assert told["action"]["speed"] == 0.6
    assert told["track"]["state"][-1][0] == pytest.approx(0.56 + 0.3 * np.cos(told["action"]["yaw"]), abs=1e-6)
    (row,) = printed("sessions", "list", "--json")["sessions"]
    assert (row["method"], row["trials"], row["hw"]) == ("rollout", 1, "own")


@pytest.mark.long
def test_control_trials_are_made_by_the_robot_too(printed, answers) -> None:
    line = ("run-iteration", *answers[2:], "--answer-moves", "nothing", "--yes", "--json", "--session", "both")
    first = printed(*line, "--hw", "own", "--task", "pushing", "--control", "udr")
    assert first["control"] is None, "its first iteration has no partner"
    assert printed(*line)["control"]["pairs"] == 4


@pytest.mark.slow
def test_a_robot_that_computes_the_simulated_labs_world_gives_the_simulated_labs_numbers() -> None:
    lab = api.begin("pushing", world=WORLD, name="lab")
    lab.run_iteration()
    task = get_task("pushing")
    world = load_world(WORLD, task)
    own = api.begin("pushing", hw="own", name="own")
    for trial in own.asks():
        context, action = (np.array(list(part.values())) for part in (trial.context, trial.action or {}))
        track = rollout_in(world, context, action)
        own.tell(trial, track.t_s, track.state, track.outcome.value, rest_s=float(track.t_s[-1]))
    assert [t.action for t in own.trials] == [t.action for t in lab.trials]
    assert [t.reward for t in own.trials] == [t.reward for t in lab.trials]
    assert [t.observation for t in own.trials] == [t.observation for t in lab.trials]
    assert own.iterations[0].next_parameters == lab.iterations[0].next_parameters
    assert np.array_equal(own.posterior().mean, lab.posterior().mean)


@pytest.mark.long
def test_the_page_is_followed_as_it_is_written(place, capfd, monkeypatch) -> None:
    text = (ROOT / "docs/guide/own-robot.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"<!-- file my_robot.py -->\n```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    (place / "my_robot.py").write_text(code)
    blocks = FENCE.findall(text)
    (line,) = [code for _, language, code in blocks if language == "sh" and "my_robot.py" in code]
    command = shlex.split(line.replace('"python ', f'"{sys.executable} '))
    assert app.run(command[1:]) == 0
    told = capfd.readouterr().out
    assert "YOUR ROBOT" in told
    assert "adaptsim run-iteration --session pushing-own" in told
    (notebook,) = [code for _, language, code in blocks if language == "python" and "session.ask()" in code]
    exec(notebook, {})
    assert len(api.open_session("notebook").trials) == 4
    assert all(set(trial.observation) == {None} for trial in api.open_session("notebook").trials)


def test_the_schemas_of_question_and_answer_are_published(printed, capfd) -> None:
    for name, keys in (("question", {"trial", "action", "units"}), ("answer", {"t_s", "state", "outcome", "end"})):
        capfd.readouterr()
        assert app.run(["schema", "own-robot", name]) == 0
        schema = json.loads(capfd.readouterr().out)
        assert keys <= set(schema["properties"])
        assert schema["additionalProperties"] is False
    assert "reward" not in schema["properties"]
