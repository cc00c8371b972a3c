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
    force: Annotated[bool, typer.Option("--force", help="Replace a file named by --out.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Path of the page, as JSON on stdout.")] = False,
) -> None:
    """Write one self-contained HTML page of a session: is it better, rewards, parameters, paths, camera frames.

    Example: adaptsim report scooping-oreo-adaptsim-seed0
    """
    import shlex

    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import store
    from adaptsim_cli.storage import durable
    from adaptsim_cli.wiring.hindsight import Reports

    root = config.load().places.sessions
    opened = store.SessionStore.open(root, session or store.newest(root))
    screen = console.Screen(as_json=as_json)
    if out is not None:
        durable.require_new(out, force=force)
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


def compare(
    sessions: Annotated[
        list[str],
        typer.Argument(help="Names of two sessions or more, of one task.", autocompletion=completing.sessions),
    ],
    out: Annotated[Path | None, typer.Option("--out", help="Folder for page and tables.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The comparison as one JSON object on stdout.")] = False,
) -> None:
    """Compare sessions: methods, worlds, days, posteriors. Writes a page, and CSV of the sessions and of the trials.

    Example: adaptsim compare scooping-oreo-adaptsim-seed0 scooping-ood-1-udr-seed0
    """
    import hashlib
    from dataclasses import asdict

    from adaptsim_cli import config
    from adaptsim_cli.report import comparison
    from adaptsim_cli.report.posteriors import disagreements
    from adaptsim_cli.screen import console, views
    from adaptsim_cli.session.store import SessionStore
    from adaptsim_cli.wiring.posteriors import believed

    places = config.load().places
    names = tuple(dict.fromkeys(sessions))
    stores = [SessionStore.open(places.sessions, name) for name in names]
    found, beliefs = comparison.compared(stores), believed(stores)
    digest = hashlib.sha256("\n".join(names).encode()).hexdigest()[:8]
    folder = out or places.data / "comparisons" / f"{found[0].facts.task}-{len(found)}-sessions-{digest}"
    path = comparison.write(found, folder.absolute(), beliefs)
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data(
            "compare",
            {
                "task": found[0].facts.task,
                "sessions": [c.as_row() for c in found],
                "methods": [row.as_json() for row in comparison.by_method(found)],
                "posteriors": [asdict(one) for one in beliefs],
                "page": str(path),
                "tables": [str(path.with_name(name)) for name in (comparison.SESSIONS, comparison.TRIALS)],
            },
        )
        return
    body = [
        (c.facts.name, f"{c.iterations[0].mean:.2f}", f"{c.iterations[-1].mean:.2f}", str(len(c.trials))) for c in found
    ]
    screen.show(views.rows(("session", "first", "last", "trials"), body, right=(1, 2, 3)))
    screen.plain("First and last: mean reward of the first and of the last iteration.")
    for sentence in (*comparison.conclusions(found), *disagreements(beliefs)):
        screen.plain(sentence)
    screen.plain(f"Page: {path}")
    screen.next((f"xdg-open {path}", "the page, in the browser"))
