"""`adaptsim config show/path`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adaptsim_cli import options

app = typer.Typer(help="Settings, and where each comes from.", no_args_is_help=True)


@app.command()
def show(as_json: options.Json = False) -> None:
    """Show every setting with its value and origin, and the contents of the rig file.

    Example: adaptsim config show
    """
    from dataclasses import asdict

    from adaptsim_cli import config
    from adaptsim_cli.devices.rig_file import reading
    from adaptsim_cli.screen import console, views

    resolved = config.load()
    settings = {k: {"value": v, "source": resolved.sources[k]} for k, v in resolved.config.model_dump().items()}
    screen = console.Screen(as_json=as_json)
    body = [(name, str(s["value"]) or '""', str(s["source"])) for name, s in settings.items()]
    if not as_json:  # before the rig file, which may be damaged
        screen.show(views.rows(("setting", "value", "from"), body))
    rig = asdict(reading.read(Path(resolved.config.rig))) if resolved.config.rig else None
    if screen.data("config show", {"settings": settings, "rig_file": rig}):
        return
    if rig is not None:
        screen.plain("")
        screen.show(views.rows((resolved.config.rig, "value"), reading.flat(rig)))
        screen.next(("adaptsim doctor", "checks that everything is ready"))
    else:
        screen.plain("No rig file, so no real arm.")
        screen.next(("adaptsim setup --hw fr3", "asks about the lab, and leads to the first trial"))


@app.command()
def path(as_json: options.Json = False) -> None:
    """Show the folders of data and settings. ADAPTSIM_HOME moves both.

    Example: adaptsim config path
    """
    from dataclasses import asdict

    from adaptsim_cli import config
    from adaptsim_cli.screen import console

    where = {name: str(place) for name, place in asdict(config.places()).items()}
    screen = console.Screen(as_json=as_json)
    if not screen.data("config path", where):
        for name, place in where.items():
            screen.plain(f"{name.replace('_', ' '):<13} {place}")
        screen.next(("adaptsim config show", "all settings, and where each comes from"))


def schema(
    command: Annotated[
        list[str] | None, typer.Argument(help="Command, e.g. sessions list; default: all of them.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Print the JSON schema of what a command prints with --json: names, types, units, meanings.

    `own-robot question` and `own-robot answer` are what a robot of your own is asked, and answers.
    Without a command it lists those that take --json. Every output begins with its `version`.

    Example: adaptsim schema sessions list
    """
    import difflib
    import json

    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.outputs import catalogue
    from adaptsim_cli.screen import console, views

    name = " ".join(command or ()).removeprefix("adaptsim ").strip()
    if name and name not in catalogue.SCHEMAS:
        near = difflib.get_close_matches(name, catalogue.SCHEMAS, n=3)
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise UsageError(f"no command {name!r} takes --json{hint} `adaptsim schema` lists those that do")
    screen = console.Screen(as_json=as_json)
    names = [name] if name else list(catalogue.SCHEMAS)
    if screen.data("schema", {"schemas": {one: catalogue.schema(one) for one in names}}):
        return
    if name:
        screen.plain(json.dumps(catalogue.schema(name), indent=2, ensure_ascii=False))
    else:
        rows = [(one, (kind.__doc__ or "").splitlines()[0]) for one, kind in catalogue.SCHEMAS.items()]
        screen.show(views.rows(("command", "its output with --json"), rows))
        screen.next(("adaptsim schema run-iteration", "every key with its type, unit and meaning"))
