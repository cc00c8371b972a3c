"""`adaptsim sessions list/show/verify/redo/accept/amend`."""

from __future__ import annotations

from typing import Annotated

import typer

from adaptsim_cli.commands import completing, exporting, keeping

app = typer.Typer(help="List, check, correct, archive, prune and export stored sessions.", no_args_is_help=True)

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
    from adaptsim_cli.outputs.sessions import Damaged
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import store, summary, terminal_views
    from adaptsim_cli.session.keeping import archive_of

    root = config.load().places.sessions
    root = archive_of(root) if archived else root
    found = [summary.overview_or_damage(root, name) for name in store.names(root)]
    if task is not None:
        found = [one for one in found if isinstance(one, Damaged) or one.task == task]
    if tag is not None:
        found = [one for one in found if isinstance(one, Damaged) or tag in one.tags]
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data("sessions list", {"sessions": found})
    elif found:
        screen.show(terminal_views.sessions(found))
        whole = [one.session for one in found if not isinstance(one, Damaged)]
        for name in whole[-1:]:
            screen.next(
                (f"adaptsim sessions show {name}", "every trial of the newest"),
                (f"adaptsim run-iteration --session {name}", "goes on with it"),
            )
    else:
        chosen = " that match" if task is not None or tag is not None else ""
        screen.plain(f"No sessions{chosen} in {root}. Begin one: adaptsim run-iteration --task scooping")


@app.command()
def show(name: _Name, as_json: _Json = False) -> None:
    """Show every completed trial and iteration of a session.

    Example: adaptsim sessions show scooping-oreo-adaptsim-seed0
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import store, summary, terminal_views

    shown = summary.details(store.SessionStore.open(config.load().places.sessions, name))
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data("sessions show", shown)
    else:
        screen.show(terminal_views.session(shown))
        rejected = {one.trial for one in shown.rejected} - {one.trial for one in shown.trials}
        screen.next(
            (f"adaptsim run-iteration --session {name}", "goes on with it"),
            (f"adaptsim report {name}", "pictures, paths and parameters on one page"),
            *((f"adaptsim sessions accept {name} {trial}", "lets the rejected attempt count") for trial in rejected),
        )


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

    Example: adaptsim sessions verify scooping-oreo-adaptsim-seed0
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import SessionError
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import keeping, store, terminal_views

    root = config.load().places.sessions
    screen = console.Screen(as_json=as_json)
    checked = []
    for name in names or store.names(root):
        with screen.busy(f"Reading {name}"):
            checked.append(keeping.verify(root, name))
    if as_json:
        screen.data("sessions verify", {"sessions": [one.as_json() for one in checked]})
    elif checked:
        screen.show(terminal_views.verified(checked))
        if not any(one.damage for one in checked):
            screen.next(("adaptsim sessions list", "all files are intact"))
    else:
        screen.plain(f"No sessions yet in {root}. Begin one: adaptsim run-iteration --task scooping")
    if damage := [message for one in checked for message in one.damage]:
        others = f" And {len(damage) - 1} more." if len(damage) > 1 else ""
        raise SessionError(f"{damage[0]}.{others} A trial can be done again: adaptsim sessions redo NAME TRIAL")


@app.command()
def redo(
    name: _Name,
    trial: Annotated[int, typer.Argument(min=1, help="Number of the trial, as `sessions show` lists it.")],
    reason: Annotated[str, typer.Option("--reason", help="Why it does not count.")] = "the operator asked for a "
    "repetition",
    as_json: _Json = False,
) -> None:
    """Mark a trial as bad: the next run-iteration repeats it and adapts again.

    Example: adaptsim sessions redo scooping-oreo-adaptsim-seed0 3 --reason "the piece was touched"
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import correcting, store

    opened = store.SessionStore.open(config.load().places.sessions, name)
    attempt = correcting.redo(opened, trial, reason)
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data("sessions redo", {"session": name, "trial": trial, "next_attempt": attempt})
    else:
        screen.plain(f"Trial {trial} of {name} will be done again.")
        screen.next(
            (f"adaptsim run-iteration --session {name}", "repeats it and adapts again"),
            (f"adaptsim sessions accept {name} {trial}", "if it should count after all"),
        )


@app.command()
def accept(
    name: _Name,
    trial: Annotated[int, typer.Argument(min=1, help="Number of the trial, as `sessions show` lists it.")],
    attempt: Annotated[
        int | None,
        typer.Option("--attempt", min=1, help="Which attempt; default: the newest with a recording."),
    ] = None,
    reason: Annotated[str, typer.Option("--reason", help="Why it counts after all.")] = "restored by the operator",
    as_json: _Json = False,
) -> None:
    """Take back a rejection: the attempt counts again. Nothing moves, nothing is deleted.

    Example: adaptsim sessions accept scooping-oreo-adaptsim-seed0 3
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import correcting, store, terminal_views

    opened = store.SessionStore.open(config.load().places.sessions, name)
    changed = correcting.restore(opened, trial, None if attempt is None else attempt - 1, reason)
    terminal_views.tell_amended(console.Screen(as_json=as_json), "sessions accept", name, changed, as_json=as_json)


@app.command()
def amend(
    name: _Name,
    trial: Annotated[int, typer.Argument(min=1, help="Number of the trial, as `sessions show` lists it.")],
    outcome: Annotated[
        str | None, typer.Option("--outcome", help="The outcome that you saw, e.g. on_blade; without it you are asked.")
    ] = None,
    reason: Annotated[str, typer.Option("--reason", help="How you know.")] = "amended by the operator",
    as_json: _Json = False,
) -> None:
    """Set another outcome of an accepted trial, of any iteration, after looking at its recording.

    Later trials stay as they are; the next adaptation takes the new outcome into account and says so.

    Example: adaptsim sessions amend scooping-oreo-adaptsim-seed0 1 --outcome on_table --reason "it fell off at home"
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import correcting, store, terminal_views
    from adaptsim_cli.session.operator import choose_amendment
    from adaptsim_cli.wiring.session import seen_by_camera

    if outcome is None:
        console.require_terminal("there is no terminal to ask at: give the outcome with --outcome")
    resolved = config.load()
    opened = store.SessionStore.open(resolved.places.sessions, name)
    task, outcomes = seen_by_camera(resolved.config, opened.facts)
    record, choices = correcting.amendable(opened, task, outcomes, trial)
    screen = console.Screen(as_json=as_json)
    chosen = choose_amendment(screen, opened, record, choices, outcome)
    changed = correcting.amend(opened, task, trial, chosen, choices[chosen], reason)
    terminal_views.tell_amended(screen, "sessions amend", name, changed, as_json=as_json)


keeping.add_to(app)
app.command()(exporting.export)
