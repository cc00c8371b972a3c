"""`adaptsim report`: one page of a session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adaptsim_cli.commands import completing


def report(
    session: Annotated[
        str | None,
        typer.Argument(help="Name of the session; default: the newest.", autocompletion=completing.sessions),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Where to write the page.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Path of the page, as JSON on stdout.")] = False,
) -> None:
    """Write one self-contained HTML page of a session: is it better, rewards, parameters, paths, camera frames.

    Example: adaptsim report scooping-oreo-adaptsim-seed0
    """
    import shlex

    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import store
    from adaptsim_cli.wiring.hindsight import Reports

    root = config.load().places.sessions
    opened = store.SessionStore.open(root, session or store.newest(root))
    screen = console.Screen(as_json=as_json)
    with screen.busy("Drawing the report"):
        path = Reports().draw(opened, out)
    if as_json:
        screen.data("report", {"session": opened.facts.name, "report": str(path)})
    else:
        screen.plain(f"Report: {path}")
        screen.next(
            (f"xdg-open {shlex.quote(str(path))}", "opens it in the browser; it is a single file that you can send"),
            (f"adaptsim run-iteration --session {opened.facts.name}", "goes on with the session"),
        )
