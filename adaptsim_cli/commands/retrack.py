"""`adaptsim retrack`."""

from __future__ import annotations

from typing import Annotated

import typer

from adaptsim_cli.commands import completing


def retrack(
    session: Annotated[str, typer.Argument(help="Name of the session.", autocompletion=completing.sessions)],
    trial: Annotated[
        int | None, typer.Option("--trial", min=1, help="Number of one trial, as `sessions show` lists it.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Track the recordings of a session again, with the tracker of this version. Nothing stored is changed.

    Example: adaptsim retrack scooping-oreo-adaptsim-seed0 --trial 2
    """
    from adaptsim_cli import config
    from adaptsim_cli.devices.trackers import tracker_of
    from adaptsim_cli.screen import console, views
    from adaptsim_cli.session import retracking, store
    from sim.tasks import get_task

    opened = store.SessionStore.open(config.load().places.sessions, session)
    task = get_task(opened.facts.task)
    retracking.require_camera(task)
    screen = console.Screen(as_json=as_json)
    with screen.busy("Tracking"):
        found = tuple(retracking.retrack(opened, task, tracker_of(task), trial))
    if as_json:
        told = [one.as_json(opened.facts) for one in found]
        screen.data("retrack", {"session": session, "units": opened.facts.units, "trials": told})
    else:
        screen.show(views.rows(retracking.HEAD, retracking.rows(found), right=(0, 3, 4, 5, 6)))
        screen.next(*retracking.next_steps(session, found))
    retracking.require_tracked(found)
