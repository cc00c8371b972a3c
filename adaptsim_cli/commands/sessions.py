"""`adaptsim sessions list/show/index/verify/mark/delete/prune/redo/accept/amend/policy`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adaptsim_cli import options
from adaptsim_cli.commands import exporting

app = typer.Typer(help="List, check, mark, correct, prune and export stored sessions.", no_args_is_help=True)
app.command()(exporting.export)


@app.command("list")
def list_sessions(
    task: Annotated[
        str | None, typer.Option("--task", autocompletion=options.task_names, help="Only those of this task.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """List all sessions, newest last: task, world, verdict, trials, size and note.

    Example: adaptsim sessions list
    """
    from adaptsim_cli import config
    from adaptsim_cli.outputs.sessions import Damaged
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import folders, summary, terminal_views

    root = config.load().places.sessions
    rows = [summary.overview_or_damage(root, name) for name in folders.names(root)]
    if task is not None:
        rows = [one for one in rows if isinstance(one, Damaged) or one.task == task]
    screen = console.Screen(as_json=as_json)
    if note := folders.stray_note(root):
        screen.note(note)
    if screen.data("sessions list", {"sessions": rows}):
        return
    if not rows:
        chosen = " that match" if task is not None else ""
        screen.plain(f"No sessions{chosen} in {root}. Begin one: adaptsim run-iteration --task scooping")
        return
    screen.show(terminal_views.sessions(rows))
    for name in [one.session for one in rows if not isinstance(one, Damaged)][-1:]:
        screen.next(
            (f"adaptsim sessions show {name}", "every trial of the newest"),
            (f"adaptsim run-iteration --session {name}", "continues this session"),
        )


@app.command()
def show(name: options.Session, as_json: options.Json = False) -> None:
    """Show every completed trial and iteration of a session.

    Example: adaptsim sessions show scooping-oreo
    """
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import summary, terminal_views

    shown = summary.details(options.stored(name))
    screen = console.Screen(as_json=as_json)
    if screen.data("sessions show", shown):
        return
    screen.show(terminal_views.session(shown))
    rejected = {one.trial for one in shown.rejected} - {one.trial for one in shown.trials}
    screen.next(
        (f"adaptsim run-iteration --session {name}", "continues this session"),
        (f"adaptsim report {name}", "pictures, paths and parameters on one page"),
        *((f"adaptsim sessions accept {name} {trial}", "lets the rejected attempt count") for trial in rejected),
    )


@app.command()
def index(
    out: Annotated[
        Path | None, typer.Option("--out", help="HTML file to write; default: index.html in the sessions' folder.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Write one page of all sessions: by world and method, sortable, linked to reports and films.

    Example: adaptsim sessions index
    """
    from adaptsim_cli import config
    from adaptsim_cli.report import index as page
    from adaptsim_cli.screen import console

    screen = console.Screen(as_json=as_json)
    path, count = page.write(config.load().places.sessions, out)
    if screen.data("sessions index", {"page": str(path), "sessions": count}):
        return
    screen.plain(f"Sessions: {count}, {path}")
    screen.next((f"xdg-open {path}", "opens the page; its links lead to the files beside it"))


@app.command()
def verify(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Names of sessions; without one, all of them.", autocompletion=options.session_names),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Read every file of a session and compare it with its checksum.

    Ends with exit code 8 when a file is damaged. Nothing is changed.

    Example: adaptsim sessions verify scooping-oreo
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import SessionError
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import folders, keeping, terminal_views

    root = config.load().places.sessions
    screen = console.Screen(as_json=as_json)
    if not names and (note := folders.stray_note(root)):
        screen.note(note)
    checked = []
    for name in names or folders.names(root):
        with screen.busy(f"Reading {name}"):
            checked.append(keeping.verify(root, name))
    damage = [message for one in checked for message in one.damage]
    if not screen.data("sessions verify", {"sessions": checked}):
        if checked:
            screen.show(terminal_views.verified(checked))
        else:
            screen.plain(f"No sessions yet in {root}. Begin one: adaptsim run-iteration --task scooping")
        if checked and not damage:
            screen.next(("adaptsim sessions list", "all files are intact"))
    if damage:
        others = f" And {len(damage) - 1} more." if len(damage) > 1 else ""
        raise SessionError(f"{damage[0]}.{others} A trial can be done again: adaptsim sessions redo NAME TRIAL")


@app.command()
def mark(
    name: options.Session,
    note: Annotated[str | None, typer.Option("--note", help="A note in place of an earlier one; '' for none.")] = None,
    as_json: options.Json = False,
) -> None:
    """Write a note to a session. No record is changed.

    Example: adaptsim sessions mark scooping-oreo --note "before the camera was moved"
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import keeping

    if note is None:
        raise UsageError("nothing to mark: add --note 'TEXT' (an empty text removes the note)")
    marked = keeping.mark(config.load().places.sessions, name, note)
    screen = console.Screen(as_json=as_json)
    if not screen.data("sessions mark", marked):
        screen.plain(f"{name}: {marked.note or 'no note'}")
        screen.next(("adaptsim sessions list", "shows it"))


@app.command()
def delete(name: options.Session, yes: options.Sure = False, as_json: options.Json = False) -> None:
    """Remove a session for good, after you type its name.

    Example: adaptsim sessions delete scooping-oreo
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import StoppedByOperator
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import folders, keeping, terminal_views

    root = config.load().places.sessions
    folder = folders.folder_of(root, name)
    screen = console.Screen(as_json=as_json)
    if folder.is_dir() and not yes:
        console.require_terminal("deleting asks for the name of the session: run in a terminal, or add --yes")
        screen.plain(f"{folder} takes {terminal_views.size(keeping.size_bytes(folder))}. Deleting cannot be undone.")
        if screen.ask_text("Type the name of the session to delete it, or Enter to keep it:") != name:
            raise StoppedByOperator(f"kept: session {name} is unchanged")
    keeping.delete(root, name)
    screen.data("sessions delete", {"session": name, "deleted": True})
    screen.plain(f"Deleted: {name}")
    screen.next(("adaptsim sessions list", "the remaining sessions"))


@app.command()
def prune(
    name: options.Session,
    rejected: Annotated[bool, typer.Option("--rejected", help="Only of attempts that do not count.")] = False,
    yes: options.Sure = False,
    as_json: options.Json = False,
) -> None:
    """Remove the recordings of a session to make room. Records, key moments and report stay.

    Without its recordings a session can still be continued, compared and exported as a table; it cannot be replayed or
    tracked again.

    Example: adaptsim sessions prune scooping-oreo --rejected
    """
    from adaptsim_cli.errors import StoppedByOperator
    from adaptsim_cli.screen import console
    from adaptsim_cli.screen.keys import Key, agree
    from adaptsim_cli.session import keeping, terminal_views

    opened, screen = options.stored(name), console.Screen(as_json=as_json)
    room = keeping.prunable(opened, rejected_only=rejected)
    what = f"{room.files} recordings of {room.trials} trials, {terminal_views.size(room.size_bytes)}"
    if room.files and not yes:
        console.require_terminal("pruning asks first: run in a terminal, or add --yes")
        screen.plain(f"This removes {what}. It cannot be undone.")
        remove = agree("to remove them", "The recordings are removed for good; records, key moments and report stay.")
        keep = Key("", "to keep them", "Nothing is removed.", is_way_out=True)
        if screen.choose("Remove them?", remove, keep) != "y":
            raise StoppedByOperator(f"kept: the recordings of {name} are unchanged")
    if room.files:
        room = keeping.prune(opened, rejected_only=rejected)
    screen.data("sessions prune", room)
    screen.plain(f"Removed: {what}" if room.files else f"Nothing to remove in {name}")
    screen.next((f"adaptsim sessions verify {name}", "checks that every other file is intact"))


@app.command()
def redo(
    name: options.Session,
    trial: options.Trial,
    reason: Annotated[str, typer.Option("--reason", help="Why it does not count.")] = "the operator asked for a "
    "repetition",
    as_json: options.Json = False,
) -> None:
    """Mark a trial as bad: the next run-iteration repeats it and adapts again.

    Example: adaptsim sessions redo scooping-oreo 3 --reason "the piece was touched"
    """
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import correcting

    attempt = correcting.redo(options.stored(name), trial, reason)
    screen = console.Screen(as_json=as_json)
    if not screen.data("sessions redo", {"session": name, "trial": trial, "next_attempt": attempt}):
        screen.plain(f"Trial {trial} of {name} will be done again.")
        screen.next(
            (f"adaptsim run-iteration --session {name}", "repeats it and adapts again"),
            (f"adaptsim sessions accept {name} {trial}", "if it should count after all"),
        )


@app.command()
def accept(
    name: options.Session,
    trial: options.Trial,
    attempt: Annotated[
        int | None,
        typer.Option(
            "--attempt",
            rich_help_panel=options.ADVANCED,
            min=1,
            help="Which attempt; default: the newest with a recording.",
        ),
    ] = None,
    reason: Annotated[str, typer.Option("--reason", help="Why it counts after all.")] = "restored by the operator",
    as_json: options.Json = False,
) -> None:
    """Take back a rejection: the attempt counts again. Nothing moves, nothing is deleted.

    Example: adaptsim sessions accept scooping-oreo 3
    """
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import correcting, terminal_views

    changed = correcting.restore(options.stored(name), trial, None if attempt is None else attempt - 1, reason)
    terminal_views.tell_amended(console.Screen(as_json=as_json), "sessions accept", *changed)


@app.command()
def amend(
    name: options.Session,
    trial: options.Trial,
    outcome: Annotated[
        str | None, typer.Option("--outcome", help="The outcome that you saw, e.g. on_blade; without it you are asked.")
    ] = None,
    reason: Annotated[str, typer.Option("--reason", help="How you know.")] = "amended by the operator",
    as_json: options.Json = False,
) -> None:
    """Set another outcome of an accepted trial, of any iteration, after looking at its recording.

    Later trials stay as they are; the next adaptation takes the new outcome into account and says so.

    Example: adaptsim sessions amend scooping-oreo 1 --outcome on_table --reason "it fell off at home"
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import correcting, terminal_views
    from adaptsim_cli.session.operator import choose_amendment
    from adaptsim_cli.wiring.session import seen_by_camera

    if outcome is None:
        console.require_terminal("there is no terminal to ask at: give the outcome with --outcome")
    opened = options.stored(name)
    task, outcomes = seen_by_camera(config.load().config, opened.facts)
    record, choices = correcting.amendable(opened, task, outcomes, trial)
    screen = console.Screen(as_json=as_json)
    chosen = choose_amendment(screen, opened, record, choices, outcome)
    changed = correcting.amend(opened, task, trial, chosen, choices[chosen], reason)
    terminal_views.tell_amended(screen, "sessions amend", *changed)


@app.command()
def policy(
    name: options.Session,
    out: Annotated[Path | None, typer.Option("--out", help="JSON file to write; default: stdout.")] = None,
    as_json: options.Json = False,
) -> None:
    """Export the best policy of a session: its action at contexts over the whole area, with names and units.

    `adaptsim rollout --session NAME --best` runs it.

    Example: adaptsim sessions policy scooping-oreo --out policy.json
    """
    import json

    from adaptsim_cli.screen import console
    from adaptsim_cli.session.exporting import written
    from adaptsim_cli.wiring import best

    screen = console.Screen(as_json=as_json or out is None)
    with screen.busy("Training the best policy"):
        exported = best.export(options.stored(name))
    if out is not None:
        written(out, (json.dumps(exported, allow_nan=False, indent=1) + "\n").encode())
    if not screen.data("sessions policy", exported):
        screen.plain(f"Policy: {out}")
        screen.next((f"adaptsim rollout --session {name} --best", "one trial with it"))
