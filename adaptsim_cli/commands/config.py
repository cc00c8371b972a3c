"""`adaptsim config show/path`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen

app = typer.Typer(help="Settings, and where each comes from.", no_args_is_help=True)


@app.command()
@command()
def show(screen: Screen, resolved: Resolved) -> Reply:
    """Show every setting with its value and origin, and the contents of the rig file.

    Example: adaptsim config show
    """
    from dataclasses import asdict

    from adaptsim_cli.screen import views

    settings = {k: {"value": v, "source": resolved.sources[k]} for k, v in resolved.config.model_dump().items()}
    body = [(name, str(s["value"]) or '""', str(s["source"])) for name, s in settings.items()]
    if not screen.as_json:  # before the rig file, which may be damaged
        screen.show(views.rows(("setting", "value", "from"), body))
    if not resolved.config.rig:
        first_day = ("adaptsim setup --hw fr3", "asks about the lab, and leads to the first trial")
        return Reply({"settings": settings, "rig_file": None}, ["No rig file, so no real arm."], [first_day])
    from adaptsim_cli.bench.rig_file import reading

    rig = asdict(reading.read(Path(resolved.config.rig)))
    table = views.rows((resolved.config.rig, "value"), reading.flat(rig))
    return Reply(
        {"settings": settings, "rig_file": rig}, ["", table], [("adaptsim doctor", "checks that everything is ready")]
    )


@app.command()
@command()
def path(resolved: Resolved) -> Reply:
    """Show the folders of data and settings. ADAPTSIM_HOME moves both.

    Example: adaptsim config path
    """
    from dataclasses import asdict

    where = {name: str(place) for name, place in asdict(resolved.places).items()}
    lines = [f"{name.replace('_', ' '):<13} {place}" for name, place in where.items()]
    return Reply(where, lines, [("adaptsim config show", "all settings, and where each comes from")])


@app.command()
@command("hw", with_json=False)
def trust(screen: Screen, resolved: Resolved) -> Reply:
    """Confirm the files of the current folder that decide which motions are made, what is confirmed, or which programs
    run.

    Asks about each one that is not confirmed yet, or has changed since. Nothing runs or moves.

    Example: adaptsim config trust --hw fr3
    """
    from adaptsim_cli import trust as trusting
    from adaptsim_cli.bench.checkpoints import task_claims
    from adaptsim_cli.bench.rig_file.claims import rig_claims
    from adaptsim_cli.screen import console
    from adaptsim_cli.session.own.trust import own_claims

    config, where = resolved.config, resolved.places
    claims = task_claims(resolved)
    if not config.is_simulated:
        claims += own_claims(resolved) if config.is_own else rig_claims(config, where)
    if not claims:
        return Reply(text=["Nothing of the current folder has to be confirmed."])
    console.require_terminal("a person confirms these files at a terminal: run it there")
    trusting.require(claims, trusting.Trust(where.trust_file), screen, asks=True, command="adaptsim config trust")
    return Reply(text=[f"Confirmed: the {claim.kind} {claim.place}" for claim in claims])


@command()
def schema(
    command: Annotated[
        list[str] | None,
        typer.Argument(help="Command, e.g. sessions list; default: all of them."),
    ] = None,
) -> Reply:
    """Print the JSON schema of the output of a command with --json: names, types, units, meanings.

    `own-robot question` and `own-robot answer` are the question to a robot of your own, and its answer. Without a
    command it lists those that take --json. Every output begins with its `version`.

    Example: adaptsim schema sessions list
    """
    import difflib
    import json

    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.screen import views
    from adaptsim_cli.screen.outputs import catalogue

    name = " ".join(command or ()).removeprefix("adaptsim ").strip()
    if name and name not in catalogue.SCHEMAS:
        near = difflib.get_close_matches(name, catalogue.SCHEMAS, n=3)
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        raise UsageError(f"no command {name!r} takes --json{hint} `adaptsim schema` lists those that do")
    names = [name] if name else list(catalogue.SCHEMAS)
    data = {"schemas": {one: catalogue.schema(one) for one in names}}
    if name:
        return Reply(data, [json.dumps(data["schemas"][name], indent=2, ensure_ascii=False)])
    rows = [(one, (kind.__doc__ or "").splitlines()[0]) for one, kind in catalogue.SCHEMAS.items()]
    every_key = ("adaptsim schema run-iteration", "every key with its type, unit and meaning")
    return Reply(data, [views.rows(("command", "its output with --json"), rows)], [every_key])
