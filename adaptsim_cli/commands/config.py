"""`adaptsim config show/path/init`."""

from __future__ import annotations

from typing import Annotated

import typer

app = typer.Typer(help="Settings, and where each comes from.", no_args_is_help=True)

_Json = Annotated[bool, typer.Option("--json", help="JSON on stdout.")]


@app.command()
def show(as_json: _Json = False) -> None:
    """Every setting with its value and where it comes from.

    Example: adaptsim config show
    """
    from dataclasses import asdict

    from adaptsim_cli import config, console, views

    resolved = config.load()
    settings = {k: {"value": v, "source": resolved.sources[k]} for k, v in asdict(resolved.config).items()}
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data(settings)
    else:
        body = [(name, str(s["value"]) or '""', str(s["source"])) for name, s in settings.items()]
        screen.show(views.rows(("setting", "value", "from"), body))


@app.command()
def path(as_json: _Json = False) -> None:
    """Where data and settings lie. ADAPTSIM_HOME moves both.

    Example: adaptsim config path
    """
    from dataclasses import asdict

    from adaptsim_cli import config, console

    where = {name: str(place) for name, place in asdict(config.places()).items()}
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data(where)
    else:
        for name, place in where.items():
            screen.plain(f"{name.replace('_', ' '):<13} {place}")


@app.command()
def init(
    project: Annotated[bool, typer.Option("--project", help="Write ./adaptsim.toml instead of the user's.")] = False,
    as_json: _Json = False,
) -> None:
    """Write a settings file with every setting in it as a comment. Never overwrites one.

    Example: adaptsim config init --project
    """
    from adaptsim_cli import config, console
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.session import durable

    places = config.places()
    path = places.project_file if project else places.user_file
    if path.exists():
        raise UsageError(f"{path} exists already and is left as it is; edit it, or move it away first")
    durable.make_folder(path.parent)
    durable.write_file(path, config.template().encode())
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data({"written": str(path)})
    else:
        screen.plain(f"Written: {path}")
