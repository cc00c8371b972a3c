"""All commands on one page, from the Typer app."""

from __future__ import annotations

import inspect

import typer

from adaptsim_cli.commands import app
from pages import cell
from pages.commands import walk

HEAD = """# Cheat sheet

Written by `make docs` from the program itself. [Commands](commands.md) has every option.

`--json` prints data on stdout. `-h` explains a command. Tab completes commands, options and names after
`adaptsim --install-completion`.
"""

GLANCE = """## A session

```sh
adaptsim setup --hw fr3                                 # from an unpacked arm to the first trial
adaptsim doctor --hw fr3                                # is everything ready?
adaptsim run-iteration --task scooping --hw fr3         # four trials, and the next policies
adaptsim run-iteration -n 5 --until-done                # the newest session, until the verdict says stop
adaptsim report                                         # one page: the gain, every trial
adaptsim rollout --session scooping-fr3 --best          # one trial with the best policy
adaptsim sessions export scooping-fr3 --format csv      # every trial as a table
```
"""


def cheat_sheet() -> str:
    """One table per panel of the help: the command, its first sentence, its example."""
    rows = {name: _row(name, command) for name, command in walk(typer.main.get_command(app.app), "adaptsim")}
    parts = [HEAD, GLANCE]
    for panel, commands in app.PANELS.items():
        parts += [f"## {panel}\n", "| command | what it does |", "|---|---|"]
        parts += [row for name, row in rows.items() if name.split()[1] in commands]
        parts.append("")
    return "\n".join(parts)


def _row(name: str, command: typer.core.TyperCommand) -> str:
    text = inspect.cleandoc(command.help or "")
    first, _, _ = " ".join(text.split()).partition(". ")
    anchor = name.replace(" ", "-")
    return f"| [`{name}`](commands.md#{anchor}) | {cell(first.removesuffix('.'))} |"
