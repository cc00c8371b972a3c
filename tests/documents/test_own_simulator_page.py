"""docs/guide/own-simulator.md, followed as it is written: the five ways, and the commands with one of them."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest
from documents import marked

from adaptsim_cli import api
from adaptsim_cli.commands import app

BLOCKS = marked("guide/own-simulator.md")
FILES = {path: code for kind, path, code in BLOCKS if kind == "file"}
(USE,) = (code for kind, _, code in BLOCKS if kind == "run")
NEEDS = {"glide.py": "mujoco", "balance.py": "gymnasium"}
FEWER = {
    "pretrain": ["--rollouts", "96", "--denser", "0", "--workers", "1"],
    "world-tables": ["--workers", "1", "--rollouts", "64"],
    "benchmark": ["--workers", "1"],
    "task": ["--limit", "3"],
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    for name, code in FILES.items():
        (tmp_path / name).write_text(code, encoding="utf-8")
    return tmp_path


def checked(file: str, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    assert app.run(["task", "check", file, "--limit", "2", "--json"]) == 0
    answer: dict[str, Any] = json.loads(capsys.readouterr().out)
    return answer


def test_a_new_file_is_sound(folder, capsys):
    assert app.run(["task", "new", "my_task.py"]) == 0
    capsys.readouterr()
    assert checked("my_task.py", capsys)["sound"]
    assert app.run(["task", "new", "my_task.py"]) == 2
    assert "my_task.py exists: name another file, or replace it with --force" in capsys.readouterr().err


@pytest.mark.parametrize("file", [name for name in FILES if name.endswith(".py") and name != "my_sim.py"])
def test_each_way_is_sound_and_nothing_in_it_is_doubtful(folder, capsys, file):
    pytest.importorskip(NEEDS.get(file, "numpy"))
    answer = checked(file, capsys)
    assert answer["sound"], answer
    doubts = [one for one in answer["findings"] if one["mark"] == "doubtful"]
    assert all("states lie in their ranges" in one["check"] for one in doubts), doubts
    assert app.run(["task", "show", file]) == 0
    assert NEEDS.get(file, "") in capsys.readouterr().out


ROBOT = """import json, sys
question = json.load(sys.stdin)
x = 0.1 * question["action"]["force"]
times = [0.1 * i for i in range(21)]
print(json.dumps({"trial": question["trial"], "t_s": times, "state": [[x * t] for t in times]}))
"""


@pytest.mark.slow
def test_the_commands_of_the_page_run_one_after_another(folder, capsys):
    pytest.importorskip("mujoco")
    for line in USE.splitlines():
        program, command, *more = shlex.split(line)
        assert program == "adaptsim"
        assert app.run([command, *more, *FEWER.get(command, [])]) == 0, line
    capsys.readouterr()
    page = next((folder / "home/data/sessions").glob("glide-tilted/report.html")).read_text(encoding="utf-8")
    for word in ("away from the robot", "On the table", "camera detected", "tool is mounted"):
        assert word not in page
    (folder / "my_robot.py").write_text(ROBOT, encoding="utf-8")
    own = ["run-iteration", "--task", "glide.py", "--hw", "own", "--answer-with", f"{sys.executable} my_robot.py"]
    assert app.run([*own, "--answer-moves", "nothing", "--yes"]) == 0, capsys.readouterr().err
    assert "Is this your robot? At the end of the first trial: x" in " ".join(capsys.readouterr().out.split())
    facts = api.open_session("glide-tilted").facts
    assert facts.task_file == str(folder / "glide.py")
    text = (folder / "glide.py").read_text(encoding="utf-8")
    again = ["run-iteration", "--session", "glide-tilted", "--yes"]
    for changed, words in (
        (text.replace('"mu": (0.1, 0.3)', '"mu": (0.1, 0.35)'), "parameters: mu was 0.1 to 0.3, is 0.1 to 0.35"),
        (text.replace("data.time < 0.2", "data.time < 0.3"), "the physics of glide has changed"),
    ):
        (folder / "glide.py").write_text(changed, encoding="utf-8")
        assert app.run(again) == 8
        assert words in " ".join(capsys.readouterr().err.split())
    (folder / "glide.py").write_text(text + "\n# a note\n", encoding="utf-8")
    assert app.run(again) == 0
    assert "has changed since the session was begun" in " ".join(capsys.readouterr().out.split())
