"""Every `--json`: one versioned object that is as `adaptsim schema` says, with names and units."""

from __future__ import annotations

import json
from typing import Any

import pytest
from documents import every_command
from jsonschema import Draft202012Validator
from pydantic import ValidationError

from adaptsim_cli.commands import app
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.outputs import VERSION, catalogue, unit_of

SESSION = ["--task", "pendulum", "--world", "wd", "--session", "s", "--yes"]


def test_every_command_with_json_has_an_output_and_every_output_a_command():
    takes = {name for name, command in every_command() if any("--json" in p.opts for p in command.params)}
    assert takes == {f"adaptsim {name}" for name in catalogue.OUTPUTS}


@pytest.mark.parametrize("command", catalogue.OUTPUTS)
def test_every_schema_is_one_and_says_what_each_key_means(command):
    schema = catalogue.schema(command)
    Draft202012Validator.check_schema(schema)
    assert "version" in schema["required"]
    for part in (schema, *schema.get("$defs", {}).values()):
        assert "properties" in part or "enum" in part
        for name, field in part.get("properties", {}).items():
            assert field["description"], f"{command}: {name}"
            assert field.get("unit", "") == unit_of(name)


def test_the_end_of_a_name_is_its_unit():
    names = ("duration_s", "moved_mm", "tilt_mm_m", "turned_deg", "size_bytes", "reward")
    assert [unit_of(name) for name in names] == ["s", "mm", "mm/m", "degree", "byte", ""]


def printed(capfd: pytest.CaptureFixture[str], command: str, *more: str) -> dict[str, Any]:
    """What a command prints, checked against the schema that `adaptsim schema` prints of it."""
    capfd.readouterr()
    assert app.run([*command.split(), *more, "--json"]) == 0
    (line,) = capfd.readouterr().out.splitlines()
    found: dict[str, Any] = json.loads(line)
    assert next(iter(found.items())) == ("version", VERSION)
    assert app.run(["schema", *command.split()]) == 0
    Draft202012Validator(json.loads(capfd.readouterr().out)).validate(found)
    return found


@pytest.mark.long
def test_what_is_printed_of_a_session_from_its_first_trial_to_its_end(place, capfd):
    iteration = printed(capfd, "run-iteration", *SESSION)
    assert iteration["iteration"] == 1
    assert set(iteration["particles"][0]["params"]) <= set(iteration["units"])
    assert set(iteration["particles"][0]["trials"][0]["action"]) <= set(iteration["units"])
    other = [part if part != "s" else "other" for part in SESSION]
    printed(capfd, "run-iteration", *other, "--method", "udr")
    printed(capfd, "sessions list")
    shown = printed(capfd, "sessions show", "s")
    assert [t["trial"] for t in shown["trials"]] == [1, 2]
    printed(capfd, "sessions verify", "s")
    assert printed(capfd, "sessions mark", "s", "--note", "a note")["note"] == "a note"
    policy = printed(capfd, "sessions policy", "s")
    assert policy["quantities"]["action"][0]["unit"] == iteration["units"][policy["quantities"]["action"][0]["name"]]
    printed(capfd, "sessions export", "s", "--format", "csv")
    printed(capfd, "report", "s")
    printed(capfd, "compare", "s", "other")
    assert app.run(["compare", "s", "other"]) == 0
    assert "World wd: UDR 0." in capfd.readouterr().out
    assert "s/log.jsonl" in printed(capfd, "bundle", "s")["files"]
    assert printed(capfd, "sessions redo", "s", "2")["next_attempt"] == 2
    (rejected,) = printed(capfd, "sessions show", "s")["rejected"]
    assert (rejected["trial"], rejected["attempt"]) == (2, 1)
    assert app.run(["sessions", "show", "s"]) == 0
    assert "adaptsim sessions accept s 2" in capfd.readouterr().out
    assert printed(capfd, "sessions accept", "s", "2")["attempt"] == 1
    printed(capfd, "sessions prune", "other", "--yes")
    printed(capfd, "sessions delete", "other", "--yes")
    damaged = place / "home/data/sessions/s/session.toml"
    damaged.write_text(damaged.read_text()[:100])
    assert "error" in printed(capfd, "sessions list")["sessions"][0]


@pytest.mark.long
def test_what_is_printed_of_rollouts_worlds_checkpoints_and_settings(capfd):
    rollout = printed(capfd, "rollout", "--task", "pendulum", "--yes")
    assert set(rollout["params"]) | set(rollout["action"]) <= set(rollout["units"])
    printed(capfd, "lab list", "--task", "scooping")
    printed(capfd, "lab show", "--task", "scooping", "--world", "wd")
    printed(capfd, "checkpoints list")
    printed(capfd, "config path")
    assert printed(capfd, "config show")["settings"]["seed"] == {"value": 0, "source": "default"}
    printed(capfd, "schema")


def test_schema_lists_the_commands_and_names_those_that_are_alike(capfd, refused):
    assert app.run(["schema"]) == 0
    assert "sessions list" in capfd.readouterr().out
    assert "did you mean sessions list" in refused(2, "schema", "session", "list")


def test_a_key_that_no_model_describes_never_leaves_the_program():
    with pytest.raises(ValidationError):
        Screen(as_json=True).data("config path", {"data": "a", "user_file": "b", "project_file": "c", "more": 1})
