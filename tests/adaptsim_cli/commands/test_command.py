"""The declaration of a command: which options it gets, and how its reply is printed."""

from __future__ import annotations

import json
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from adaptsim_cli.commands.command import command
from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.reply import Reply

app = typer.Typer()
run = CliRunner()


@app.callback()
def group() -> None:
    """A group of commands."""


@app.command("path")
@command("task", "world", "seed", "realtime")
def path(screen: Screen, resolved: Resolved, name: Annotated[str, typer.Argument()], fail: bool = False) -> Reply:
    """Name the settings."""
    screen.plain("busy")
    settings = resolved.config
    line = f"{name} {settings.task} {settings.world} {settings.seed} {settings.realtime}"
    failure = SessionError("it is damaged") if fail else None
    data = {"data": line, "user_file": "", "project_file": ",".join(sorted(resolved.flags))}
    return Reply(data, [line], [("adaptsim sessions list", "why")], failure)


@pytest.fixture(autouse=True)
def at_home(tmp_path, monkeypatch):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path))
    monkeypatch.setattr("adaptsim_cli.screen.outputs.catalogue.OUTPUTS", _outputs())


def _outputs():
    from adaptsim_cli.screen.outputs import catalogue  # noqa: PLC0415 - of the command that the test declares

    return {**catalogue.OUTPUTS, "path": catalogue.OUTPUTS["config path"]}


def invoke(*words: str):
    return run.invoke(app, ["path", *words], prog_name="adaptsim")


def test_a_person_reads_text_and_the_next_command():
    result = invoke("it")
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines() == ["busy", "it scooping wd 0 False", "Next: adaptsim sessions list", "      why"]


def test_a_program_reads_json_alone_on_stdout():
    result = invoke("it", "--json")
    assert json.loads(result.stdout)["data"] == "it scooping wd 0 False"
    assert result.stderr.splitlines() == ["busy"]


def test_options_become_settings_and_a_world_decides_the_task():
    result = json.loads(invoke("it", "--world", "oreo", "--seed", "0", "--realtime", "--json").stdout)
    assert result["data"] == "it scooping oreo 0 True"
    assert result["project_file"] == "realtime,seed,world", "0 was typed, and the task was not"


def test_a_failure_follows_the_reply():
    result = invoke("it", "--fail", "--json")
    assert isinstance(result.exception, SessionError)
    assert json.loads(result.stdout)["data"]


def test_a_setting_without_an_option_is_a_mistake_of_the_program():
    with pytest.raises(KeyError):
        command("rig")
