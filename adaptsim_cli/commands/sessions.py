"""`adaptsim sessions list/show/redo/verify`."""

from __future__ import annotations

from typing import Annotated

import typer

from adaptsim_cli.commands import completing, exporting, keeping

app = typer.Typer(help="Look at stored sessions, check, keep, prune and export them.", no_args_is_help=True)

_Json = Annotated[bool, typer.Option("--json", help="JSON on stdout.")]
_Name = Annotated[str, typer.Argument(help="Name of the session.", autocompletion=completing.sessions)]


@app.command("list")
def list_sessions(
    task: Annotated[
        str | None, typer.Option("--task", autocompletion=completing.tasks, help="Only those of this task.")
    ] = None,
    tag: Annotated[str | None, typer.Option("--tag", help="Only those with this tag.")] = None,
    archived: Annotated[bool, typer.Option("--archived", help="Those in the archive.")] = False,
    as_json: _Json = False,
) -> None:
    """List all sessions, newest last: task, world, verdict, trials, size, notes and tags.

    Example: adaptsim sessions list
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import listing, store, summary
    from adaptsim_cli.session.keeping import archive_of

    root = config.load().places.sessions
    root = archive_of(root) if archived else root
    found = [summary.overview_or_damage(root, name) for name in store.names(root)]
    if task is not None:
        found = [one for one in found if "error" in one or one["task"] == task]
    if tag is not None:
        found = [one for one in found if "error" in one or tag in one["tags"]]
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data(found)
    elif found:
        screen.show(listing.sessions(found))
    else:
        chosen = " that were asked for" if task is not None or tag is not None else ""
        screen.plain(f"No sessions{chosen} in {root}. Begin one: adaptsim run-iteration --task scooping")


@app.command()
def show(name: _Name, as_json: _Json = False) -> None:
    """Show every completed trial and iteration of a session.

    Example: adaptsim sessions show scooping-ood-1-adaptsim-seed0
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import shows, store, summary

    shown = summary.details(store.SessionStore.open(config.load().places.sessions, name))
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data(shown)
    else:
        screen.show(shows.session(shown))


@app.command()
def verify(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Names of sessions; without one, all of them.", autocompletion=completing.sessions),
    ] = None,
    as_json: _Json = False,
) -> None:
    """Read every file of a session and compare it with its checksum.

    Ends with exit code 8 when a file is damaged. Nothing is changed.

    Example: adaptsim sessions verify scooping-ood-1-adaptsim-seed0
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import SessionError
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import shows, store, verifying

    root = config.load().places.sessions
    screen = console.Screen(as_json=as_json)
    checked = []
    for name in names or store.names(root):
        with screen.busy(f"Reading {name}"):
            checked.append(verifying.verify(root, name))
    if as_json:
        screen.data([one.as_json() for one in checked])
    elif checked:
        screen.show(shows.verified(checked))
    else:
        screen.plain(f"No sessions yet in {root}. Begin one: adaptsim run-iteration --task scooping")
    if damage := [message for one in checked for message in one.damage]:
        others = f" And {len(damage) - 1} more." if len(damage) > 1 else ""
        raise SessionError(f"{damage[0]}.{others} A trial can be done again: adaptsim sessions redo NAME TRIAL")


@app.command()
def redo(
    name: _Name,
    trial: Annotated[int, typer.Argument(min=1, help="Number of the trial, as `sessions show` lists it.")],
    reason: Annotated[str, typer.Option("--reason", help="Why it does not count.")] = "the operator had it redone",
    as_json: _Json = False,
) -> None:
    """Mark a trial as bad: the next run-iteration repeats it and adapts again.

    Example: adaptsim sessions redo scooping-ood-1-adaptsim-seed0 3 --reason "the piece was touched"
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import redoing, store

    opened = store.SessionStore.open(config.load().places.sessions, name)
    attempt = redoing.redo(opened, trial, reason)
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data({"session": name, "trial": trial, "next_attempt": attempt})
    else:
        screen.plain(f"Trial {trial} of {name} will be done again: adaptsim run-iteration --session {name}")


keeping.add_to(app)
app.command()(exporting.export)
