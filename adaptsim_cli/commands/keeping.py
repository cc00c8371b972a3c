"""`adaptsim sessions note/tag/archive/restore/delete/prune/policy`: keeping sessions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands import completing

if TYPE_CHECKING:
    from adaptsim_cli.session.keeping import About

_Json = Annotated[bool, typer.Option("--json", help="JSON on stdout.")]
_Name = Annotated[str, typer.Argument(help="Name of the session.", autocompletion=completing.sessions)]
_Archived = Annotated[str, typer.Argument(help="Name of the session.", autocompletion=completing.archived)]
_Yes = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")]


def add_to(app: typer.Typer) -> None:
    """Add these commands to `adaptsim sessions`."""
    for command in (note, tag, archive, restore, delete, prune, policy):
        app.command(command.__name__)(command)


def note(
    name: _Name,
    text: Annotated[str, typer.Argument(help="The note; an empty text removes it.")],
    as_json: _Json = False,
) -> None:
    """Write a note to a session, in place of an earlier one. No record is changed.

    Example: adaptsim sessions note scooping-oreo-adaptsim-seed0 "before the camera was moved"
    """
    from adaptsim_cli import config
    from adaptsim_cli.session import keeping, store

    opened = store.SessionStore.open(config.load().places.sessions, name)
    _said("sessions note", name, keeping.annotate(opened.folder, note=text), as_json=as_json)


def tag(
    name: _Name,
    tags: Annotated[list[str], typer.Argument(help="Tags to add: letters, digits, '.', '_' and '-'.")],
    remove: Annotated[bool, typer.Option("--remove", help="Remove them instead.")] = False,
    as_json: _Json = False,
) -> None:
    """Add tags to a session, or remove them. `sessions list --tag` finds them.

    Example: adaptsim sessions tag scooping-oreo-adaptsim-seed0 paper
    """
    from adaptsim_cli import config
    from adaptsim_cli.session import keeping, store

    opened = store.SessionStore.open(config.load().places.sessions, name)
    found = keeping.annotate(opened.folder, add=() if remove else tags, remove=tags if remove else ())
    _said("sessions tag", name, found, as_json=as_json)


def archive(name: _Name, as_json: _Json = False) -> None:
    """Move a session out of the list, as it is. `sessions restore` brings it back.

    Example: adaptsim sessions archive scooping-oreo-adaptsim-seed0
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import keeping

    folder = keeping.archive(config.load().places.sessions, name)
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data("sessions archive", {"session": name, "folder": str(folder)})
    screen.plain(f"Archived: {folder}")
    screen.next((f"adaptsim sessions restore {name}", "brings it back"))


def restore(name: _Archived, as_json: _Json = False) -> None:
    """Move an archived session back into the list.

    Example: adaptsim sessions restore scooping-oreo-adaptsim-seed0
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import keeping

    folder = keeping.restore(config.load().places.sessions, name)
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data("sessions restore", {"session": name, "folder": str(folder)})
    screen.plain(f"Restored: {folder}")
    screen.next((f"adaptsim sessions show {name}", "all its trials"))


def delete(name: _Name, yes: _Yes = False, as_json: _Json = False) -> None:
    """Remove a session for good, after you type its name. `sessions archive` keeps it.

    Example: adaptsim sessions delete scooping-oreo-adaptsim-seed0
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import StoppedByOperator
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import keeping, store, terminal_views

    root = config.load().places.sessions
    folder = store.folder_of(root, name)
    screen = console.Screen(as_json=as_json)
    if folder.is_dir() and not yes:
        console.require_terminal("deleting asks for the name of the session: run in a terminal, or add --yes")
        screen.plain(f"{folder} takes {terminal_views.size(keeping.size_bytes(folder))}. Deleting cannot be undone.")
        if screen.ask_text("Type the name of the session to delete it, or Enter to keep it:") != name:
            raise StoppedByOperator(f"kept: session {name} is unchanged")
    keeping.delete(root, name)
    if as_json:
        screen.data("sessions delete", {"session": name, "deleted": True})
    screen.plain(f"Deleted: {name}")
    screen.next(("adaptsim sessions list", "the remaining sessions"))


def prune(
    name: _Name,
    rejected: Annotated[bool, typer.Option("--rejected", help="Only of attempts that do not count.")] = False,
    yes: _Yes = False,
    as_json: _Json = False,
) -> None:
    """Remove the recordings of a session to make room. Records, key moments and report stay.

    Without its recordings a session can still be continued, compared and exported as a table; it cannot be replayed or
    tracked again.

    Example: adaptsim sessions prune scooping-oreo-adaptsim-seed0 --rejected
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import StoppedByOperator
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import keeping, store, terminal_views

    opened = store.SessionStore.open(config.load().places.sessions, name)
    screen = console.Screen(as_json=as_json)
    room = keeping.prunable(opened, rejected_only=rejected)
    what = f"{room.files} recordings of {room.trials} trials, {terminal_views.size(room.bytes)}"
    if room.files and not yes:
        console.require_terminal("pruning asks first: run in a terminal, or add --yes")
        screen.plain(f"This removes {what}. It cannot be undone.")
        if screen.ask("Type yes to remove them, or Enter to keep them:") != "yes":
            raise StoppedByOperator(f"kept: the recordings of {name} are unchanged")
    if room.files:
        room = keeping.prune(opened, rejected_only=rejected)
    if as_json:
        told = {"session": name, "files": room.files, "trials": room.trials, "size_bytes": room.bytes}
        screen.data("sessions prune", told)
    screen.plain(f"Removed: {what}" if room.files else f"Nothing to remove in {name}")
    screen.next((f"adaptsim sessions verify {name}", "checks that every other file is intact"))


def policy(
    name: _Name,
    out: Annotated[Path | None, typer.Option("--out", help="JSON file to write.")] = None,
    as_json: _Json = False,
) -> None:
    """Export the best policy of a session: its action at contexts over the whole area, with names and units.

    `adaptsim rollout --session NAME --best` runs it.

    Example: adaptsim sessions policy scooping-oreo-adaptsim-seed0 --out policy.json
    """
    import json

    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import store
    from adaptsim_cli.storage import durable
    from adaptsim_cli.wiring import best

    opened = store.SessionStore.open(config.load().places.sessions, name)
    screen = console.Screen(as_json=as_json)
    with screen.busy("Training the best policy"):
        exported = best.export(opened)
    if out is not None:
        durable.make_folder(out.absolute().parent)
        durable.replace_file(out.absolute(), (json.dumps(exported, allow_nan=False, indent=1) + "\n").encode())
    if as_json or out is None:
        screen.data("sessions policy", exported)
    else:
        screen.plain(f"Policy: {out}")
        screen.next((f"adaptsim rollout --session {name} --best", "one trial with it"))


def _said(command: str, name: str, about: About, *, as_json: bool) -> None:
    from adaptsim_cli.screen import console

    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data(command, {"session": name, "note": about.note, "tags": list(about.tags)})
    else:
        screen.plain(f"{name}: {about.note or 'no note'}; tags: {', '.join(about.tags) or 'none'}")
        tagged = f" --tag {about.tags[-1]}" if about.tags else ""
        screen.next((f"adaptsim sessions list{tagged}", "finds it again"))
