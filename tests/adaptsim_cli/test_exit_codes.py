"""Whatever prints "Error" ends with another exit status than 0: every command, every documented error."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from toy_rig import ToyLab, opener

from adaptsim_cli.commands import app
from adaptsim_cli.screen import exit_codes
from adaptsim_cli.session import opening
from perception.errors import TrackingFailed


def leaves(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Each command with the words that call it."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from leaves(command, (*path, name))
        else:
            yield (*path, name), command


COMMANDS = dict(leaves(typer.main.get_command(app.app)))


def called(path: tuple[str, ...]) -> list[str]:
    """The command line with a word for each argument and each option that must be given."""
    command = typer.main.get_command(app.app)
    for word in path:
        command = command.commands[word]  # type: ignore[attr-defined]
    given = list(path)
    for parameter in command.params:
        if parameter.required:
            word = "1" if parameter.name in ("trial", "number") else "s"
            given += [word] if parameter.param_type_name == "argument" else [parameter.opts[0], word]
    return given


def test_there_are_commands_to_try() -> None:
    assert len(COMMANDS) > 35


@pytest.mark.long
@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_an_error_in_any_command_ends_it_with_its_documented_code(
    path: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    line = called(path)
    callback, raised = COMMANDS[path].callback, list[BaseException]()

    @functools.wraps(callback)
    def failing(*_: object, **__: object) -> None:
        raise raised[-1]

    monkeypatch.setattr(COMMANDS[path], "callback", failing)
    for kind in exit_codes.documented_errors():
        raised.append(kind("what happened"))
        code = app.run(line)
        err = capfd.readouterr().err
        assert "what happened" in err.lower() or kind is KeyboardInterrupt, (
            "the command line of this test was refused before the command began"
        )
        assert code == exit_codes.exit_code(raised[-1]) != 0


def test_a_session_that_ends_in_an_error_without_a_trial_does_too(
    place, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def refuse(trial: int, attempt: int) -> None:
        raise TrackingFailed("the camera saw nothing")

    lab = ToyLab(0, hooks={"snapshot": refuse})
    monkeypatch.setattr(opening, "open_parts", opener(lab))
    assert app.run(["run-iteration", "--task", "toy", "--yes"]) == 6
    assert "Error: the camera saw nothing" in " ".join(capfd.readouterr().err.split())
