"""Commands that are imported when they are called, so that one command does not pay for all others."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

HELP = ("-h", "--help")
"""The names of the option that shows the help."""


@dataclass(frozen=True)
class CommandRow:
    """One command, or group of commands."""

    place: str  # module:name, inside adaptsim_cli.commands
    summary: str  # the first paragraph of its help, which the list of commands shows


class CommandGroup(TyperGroup):
    """The commands of `panels`: each panel of the help has rows by the names of their commands."""

    panels: ClassVar[Mapping[str, Mapping[str, CommandRow]]]

    def __init__(self, **words: Any) -> None:
        super().__init__(**words)
        self._is_listing = False
        self.commands = _Commands(self.panels)  # type: ignore[assignment]

    def get_params(self, ctx: Any) -> list[Any]:
        """See typer; a flag of the program shows no type either."""
        options: list[Any] = super().get_params(ctx)
        _without_types(options)
        return options

    def list_commands(self, ctx: Any) -> list[str]:
        """See typer. The order is that of `panels`; groups do not come after commands."""
        return list(self.commands)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """See typer: while the help lists all commands, only their names and sentences."""
        if cmd_name not in self.commands:
            return None
        return self.commands.listed(cmd_name) if self._is_listing else self.commands[cmd_name]  # type: ignore[attr-defined]

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """See typer; a command of a group is suggested before one that only looks similar."""
        if args and args[0] not in self.commands:
            groups = [name for name in self.commands if args[0] in getattr(self.commands[name], "commands", {})]
            if groups:
                suggestions = " or ".join(f"'adaptsim {group} {args[0]}'" for group in groups)
                ctx.fail(f"No such command '{args[0]}'. Did you mean {suggestions}?")
        return super().resolve_command(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """See typer."""
        self._is_listing = True
        try:
            super().format_help(ctx, formatter)
        finally:
            self._is_listing = False


class _Commands(Mapping[str, Any]):
    """Commands by name, imported on first use."""

    def __init__(self, panels: Mapping[str, Mapping[str, CommandRow]]) -> None:
        self._rows = {name: (panel, row) for panel, rows in panels.items() for name, row in rows.items()}

    def __getitem__(self, name: str) -> Any:
        panel, row = self._rows[name]
        return _loaded(name, panel, row)

    def __contains__(self, name: object) -> bool:
        return name in self._rows

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def listed(self, name: str) -> TyperCommand:
        panel, row = self._rows[name]
        return TyperCommand(name, help=row.summary, rich_help_panel=panel)


@cache
def _loaded(name: str, panel: str, row: CommandRow) -> Any:
    module, _, attribute = row.place.partition(":")
    command = getattr(import_module(f"adaptsim_cli.commands.{module}"), attribute)
    holder = typer.Typer()
    holder.callback()(lambda: None)  # one command alone would be the whole program
    if isinstance(command, typer.Typer):
        for one in command.registered_commands:
            assert one.callback is not None, "a command has a function"
            one.help = _unwrapped(one.help or one.callback.__doc__)
        if (alone := command.registered_callback) is not None and alone.callback is not None:
            alone.help = _unwrapped(alone.callback.__doc__)
        holder.add_typer(command, name=name, rich_help_panel=panel)
    else:
        holder.command(name, rich_help_panel=panel, help=_unwrapped(command.__doc__))(command)
    loaded = typer.main.get_command(holder).commands[name]  # type: ignore[attr-defined]
    _name_no_type_of_flags(loaded)
    return loaded


def _name_no_type_of_flags(command: Any) -> None:
    """A flag takes no value, so its help shows none."""
    named = typer.Context(command, help_option_names=list(HELP))
    _without_types([*command.params, command.get_help_option(named)])  # the command keeps its option of help
    for inner in getattr(command, "commands", {}).values():
        _name_no_type_of_flags(inner)


def _without_types(options: Sequence[Any]) -> None:
    for option in options:
        if getattr(option, "is_flag", False):
            option.metavar = ""


def _unwrapped(doc: str | None) -> str:
    """A docstring with each paragraph on one line: only the terminal wraps it."""
    return "\n\n".join(" ".join(part.split()) for part in inspect.cleandoc(doc or "").split("\n\n"))
