"""`adaptsim rollouts list/report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adaptsim_cli.commands import completing

app = typer.Typer(help="Look at stored rollouts: single trials outside any session.", no_args_is_help=True)

_Json = Annotated[bool, typer.Option("--json", help="JSON on stdout.")]


@app.command("list")
def list_rollouts(as_json: _Json = False) -> None:
    """List all rollouts, newest last.

    Example: adaptsim rollouts list
    """
    from adaptsim_cli import config
    from adaptsim_cli.outputs.sessions import RolloutRow
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import summary, terminal_views

    root = config.load().places.data / summary.ROLLOUTS
    found = [summary.rollout_overview(root, name) for name in summary.rollout_names(root)]
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data("rollouts list", {"rollouts": found})
    elif found:
        screen.show(terminal_views.rollouts(found))
        for one in [one for one in found if isinstance(one, RolloutRow)][-1:]:
            screen.next((f"adaptsim rollouts report {one.rollout}", "the newest, on a page"))
    else:
        screen.plain(f"No rollouts yet in {root}. Make one: adaptsim rollout --task scooping --yes")


@app.command()
def report(
    name: Annotated[
        str | None,
        typer.Argument(help="Name of the rollout; default: the newest.", autocompletion=completing.rollouts),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Where to write the page.")] = None,
    as_json: _Json = False,
) -> None:
    """Write one self-contained HTML page of a rollout: path, camera frames, numbers.

    Example: adaptsim rollouts report
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import SessionError
    from adaptsim_cli.report import rollout as page
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import summary

    root = config.load().places.data / summary.ROLLOUTS
    known = summary.rollout_names(root)
    if name is None and not known:
        raise SessionError(f"there are no rollouts in {root} yet; make one with adaptsim rollout")
    chosen = known[-1] if name is None else name
    path = page.write(summary.rollout_record(root, chosen), root / chosen, out)
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data("rollouts report", {"rollout": chosen, "report": str(path)})
    else:
        screen.plain(f"Report: {path}")
        screen.next((f"xdg-open {path}", "the page, in the browser"))
