"""The Python of the documents runs, and what they say of `--json` is printed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from json_page import keys_of

from adaptsim_cli import app

DOCS = Path(__file__).parents[2] / "docs"
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_the_examples_of_the_python_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    names: dict[str, object] = {}
    for code in PYTHON.findall((DOCS / "reference/python.md").read_text(encoding="utf-8")):
        exec(code, names)
    assert "track" in names
    assert (tmp_path / "data/sessions/study/report.html").is_file()


def printed(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> object:
    assert app.run(arguments) == 0
    return json.loads(capsys.readouterr().out)


def test_json_has_the_keys_that_its_page_lists(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    common = ["--task", "pendulum", "--world", "wd", "--session", "s", "--yes"]
    outputs = {
        "run-iteration": printed(["run-iteration", *common, "--json"], capsys),
        "rollout": printed(["rollout", "--task", "pendulum", "--yes", "--json"], capsys),
        "sessions list": printed(["sessions", "list", "--json"], capsys),
        "sessions verify NAME": printed(["sessions", "verify", "s", "--json"], capsys),
        "report NAME": printed(["report", "s", "--json"], capsys),
        "lab list": printed(["lab", "list", "--json"], capsys),
        "lab show": printed(["lab", "show", "--task", "scooping", "--world", "wd", "--json"], capsys),
        "checkpoints list": printed(["checkpoints", "list", "--json"], capsys),
        "config path": printed(["config", "path", "--json"], capsys),
    }
    for command, output in outputs.items():
        one = output[0] if isinstance(output, list) else output
        assert isinstance(one, dict)
        assert keys_of(command) <= set(one), command
