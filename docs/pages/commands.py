"""The reference of commands, from the Typer app."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from adaptsim_cli.commands import app
from pages import cell

COMMANDS_HEAD = """# Commands

Written by `make docs` from the program itself; `--help` of each command prints the same.

Settings come from the flag, else `ADAPTSIM_<KEY>`, else the project's `adaptsim.toml`, else the user's settings, else the
default. `adaptsim config show` prints every setting with its origin; [files](files.md#adaptsimtoml) lists them.

`--json` prints data on stdout and everything else on stderr; [JSON output](json.md) describes it.
`NO_COLOR` and `TERM=dumb` are obeyed. `adaptsim --debug` before a command shows the traceback of an error.
"""


def commands() -> str:
    """One section per command: its effect, usage, arguments, options, example."""
    parts = [COMMANDS_HEAD, "## Exit codes\n", _exit_codes()]
    for name, command in walk(typer.main.get_command(app.app), "adaptsim"):
        parts.append(_command(name, command))
    return "\n".join(parts)


def _exit_codes() -> str:
    found = re.findall(r"(\d+) ([^,.]+)", app.EXIT_CODES)
    return "\n".join(["| code | meaning |", "|---|---|", *(f"| {code} | {words} |" for code, words in found), ""])


def walk(node: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Every command with its full name, in the order of the help."""
    for word, command in node.commands.items():
        if hasattr(command, "commands"):
            if command.invoke_without_command:
                yield f"{name} {word}", command
            yield from walk(command, f"{name} {word}")
        else:
            yield f"{name} {word}", command


def _command(name: str, command: Any) -> str:
    text, _, example = inspect.cleandoc(command.help or "").partition("Example: ")
    arguments = [p.name.upper() for p in command.params if _is_argument(p)]
    rows = [_option(p) for p in command.params if p.name != "help"]
    lines = [f"## {name}\n", f"`{' '.join([name, *arguments])}`\n", _joined(text) + "\n"]
    if rows:
        lines += ["| option | default | meaning |", "|---|---|---|", *rows, ""]
    if example:
        lines += ["```sh", example.strip(), "```", ""]
    return "\n".join(lines)


def _is_argument(parameter: Any) -> bool:
    return not parameter.opts[0].startswith("-")


def _joined(text: str) -> str:
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.strip().split("\n\n"))


def _option(parameter: Any) -> str:
    flags = [parameter.name.upper()] if _is_argument(parameter) else [*parameter.opts, *parameter.secondary_opts]
    shown = ", ".join(f"`{flag}`" for flag in sorted(flags, key=len, reverse=True))
    kind = {int: "N", float: "NUMBER", str: "TEXT", Path: "PATH"}.get(parameter.type_descriptor.annotation)
    if kind and not _is_argument(parameter):
        shown += f" {kind}"
    default = parameter.show_default if isinstance(parameter.show_default, str) else parameter.default
    plain = default in (None, False, "", ()) or callable(default)
    return f"| {shown} | {'' if plain else f'`{default}`'} | {cell(parameter.help or '')} |"
