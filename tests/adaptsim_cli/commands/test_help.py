"""What `--help` shows: commands in panels, rare options apart, defaults, paragraphs that the terminal wraps."""

from __future__ import annotations

from typing import Any

import pytest
import typer

from adaptsim_cli.commands import app
from adaptsim_cli.commands.options import ADVANCED, ROBOT
from adaptsim_cli.config import Config

RARE = {"--denser", "--episodes", "--judged", "--shift", "--refine-intrinsics", "--own-calibration"}
RARE |= {"--view-port", "--square-mm", "--attempt", "--png"}


def walk(node: Any, path: str = "") -> list[tuple[str, Any]]:
    below = getattr(node, "commands", {})
    here = [(path, node)] if path else []
    return [*here, *(pair for name, one in below.items() for pair in walk(one, f"{path} {name}".strip()))]


COMMANDS = dict(walk(typer.main.get_command(app.app)))
OPTIONS = [(path, option) for path, command in COMMANDS.items() for option in command.params]


def test_every_command_is_in_one_panel_and_set_up_comes_first(capfd: pytest.CaptureFixture[str]) -> None:
    app.run(["--help"])
    shown = capfd.readouterr().out
    places = [shown.index(f"─ {panel} ─") for panel in app.PANELS]
    assert places == sorted(places)
    assert list(app.PANELS) == ["Set up", "Run", "Look", "Research", "Maintain"]
    assert list(app.PANELS["Set up"])[:3] == ["setup", "doctor", "calibrate"]
    names = [name for commands in app.PANELS.values() for name in commands]
    assert sorted(names) == sorted({path.split()[0] for path in COMMANDS})
    assert "─ Commands ─" not in shown
    assert "Quick start" in shown
    assert "Documentation: " in shown


def test_the_list_of_commands_says_what_each_command_says_of_itself() -> None:
    listed = {name: row.summary for rows in app.PANELS.values() for name, row in rows.items()}
    assert listed == {name: (COMMANDS[name].help or "").partition("\n\n")[0] for name in listed}


def test_no_docstring_is_wrapped_twice() -> None:
    for path, command in COMMANDS.items():
        for paragraph in (command.help or "").split("\n\n"):
            assert "\n" not in paragraph.strip(), path


def test_rare_options_stand_apart() -> None:
    for path, option in OPTIONS:
        if set(option.opts) & RARE:
            assert option.rich_help_panel == ADVANCED, (path, option.opts)
    assert {option.rich_help_panel for _, option in OPTIONS} <= {None, ADVANCED, ROBOT}


def test_defaults_that_settings_decide_are_those_of_the_settings() -> None:
    usual, compared = Config(), 0
    for path, option in OPTIONS:
        if isinstance(option.show_default, str) and option.name in Config.model_fields:
            compared += 1
            expected = getattr(usual, option.name)
            assert option.show_default == (f"{expected:g}" if isinstance(expected, float) else str(expected)), path
    assert compared > 40


def test_a_flag_shows_no_type_and_other_options_do() -> None:
    shown = {option.is_flag: option.metavar for _, option in OPTIONS if getattr(option, "is_flag", False)}
    assert shown == {True: ""}


def test_a_command_of_a_group_is_suggested_with_its_group(capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run(["export"]) == 2
    assert "Did you mean 'adaptsim sessions export'?" in capfd.readouterr().err


@pytest.mark.parametrize("command", [[], ["sessions"], ["sessions", "list"]])
def test_no_flag_of_a_help_page_shows_a_type(command: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    app.run([*command, "--help"])
    shown = capfd.readouterr().out
    assert "--help" in shown and "<bool>" not in shown
