"""`adaptsim schema`."""

from __future__ import annotations

from typing import Annotated

import typer


def schema(
    command: Annotated[
        list[str] | None, typer.Argument(help="Command, e.g. sessions list; default: all of them.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="All schemas as one JSON object on stdout.")] = False,
) -> None:
    """Print the JSON schema of what a command prints with --json: names, types, units, meanings.

    Without a command it lists those that take --json. Every output begins with its `version`.

    Example: adaptsim schema sessions list
    """
    import difflib
    import json

    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.outputs import catalogue
    from adaptsim_cli.screen import console, views

    name = " ".join(command or ()).removeprefix("adaptsim ").strip()
    if name and name not in catalogue.OUTPUTS:
        near = difflib.get_close_matches(name, catalogue.OUTPUTS, n=3)
        meant = f"; did you mean {' or '.join(near)}?" if near else ""
        raise UsageError(f"no command {name!r} takes --json{meant} `adaptsim schema` lists those that do")
    screen = console.Screen(as_json=as_json)
    if as_json:
        names = [name] if name else list(catalogue.OUTPUTS)
        screen.data("schema", {"schemas": {one: catalogue.schema(one) for one in names}})
    elif name:
        screen.plain(json.dumps(catalogue.schema(name), indent=2, ensure_ascii=False))
    else:
        rows = [(one, (kind.__doc__ or "").splitlines()[0]) for one, kind in catalogue.OUTPUTS.items()]
        screen.show(views.rows(("command", "its output with --json"), rows))
        screen.next(("adaptsim schema run-iteration", "every key with its type, unit and meaning"))
