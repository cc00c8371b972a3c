"""`adaptsim sessions list/show/index/verify/migrate/mark/delete/prune/redo/accept/amend/policy`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands import exporting, options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply, Step

if TYPE_CHECKING:
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.session.target import Openers

app = typer.Typer(help="List, check, mark, correct, prune and export stored sessions.", no_args_is_help=True)
app.command()(exporting.export)


def _begin_one(root: Path) -> str:
    return f"in {root}. Begin one: adaptsim run-iteration --task scooping"


def _continues(name: str, why: str = "continues this session") -> Step:
    return f"adaptsim run-iteration --session {name}", why


@app.command("list")
@command()
def list_sessions(
    screen: Screen,
    resolved: Resolved,
    task: Annotated[
        str | None, typer.Option("--task", autocompletion=options.task_names, help="Only those of this task.")
    ] = None,
) -> Reply:
    """List all sessions, newest last: task, world, verdict, trials, size and note.

    Example: adaptsim sessions list
    """
    from adaptsim_cli.screen.outputs.sessions import Damaged
    from adaptsim_cli.session import folders, summary, terminal_views
    from adaptsim_cli.session.records import ROLLOUT

    root = resolved.places.sessions
    rows = [summary.overview_or_damage(root, name) for name in folders.names(root)]
    if task is not None:
        rows = [one for one in rows if isinstance(one, Damaged) or one.task == task]
    if note := folders.stray_note(root):
        screen.note(note)
    if not rows:
        chosen = " that match" if task is not None else ""
        return Reply({"sessions": []}, [f"No sessions{chosen} {_begin_one(root)}"])
    readable = [one for one in rows if not isinstance(one, Damaged)]
    steps: list[Step] = []
    if readable:
        newest = readable[-1]
        steps = [(f"adaptsim sessions show {newest.session}", "every trial of the newest")]
        if newest.method != ROLLOUT and not (newest.verdict and newest.verdict.stops):
            steps.append(_continues(newest.session))
    return Reply({"sessions": rows}, [terminal_views.sessions(rows)], steps)


@app.command()
@command()
def show(name: options.Session) -> Reply:
    """Show every completed trial and iteration of a session.

    Example: adaptsim sessions show scooping-oreo
    """
    from adaptsim_cli.session import summary, terminal_views
    from adaptsim_cli.session.advice import onwards
    from adaptsim_cli.session.history import results_of

    store = exporting.stored(name)
    shown = summary.details(store)
    steps = dict(onwards(store.facts, results_of(store), store.iterations()))  # a report stays where they put it
    steps[f"adaptsim report {name}"] = "pictures, paths and parameters on one page"
    for trial in {one.trial for one in shown.rejected} - {one.trial for one in shown.trials}:
        steps[f"adaptsim sessions accept {name} {trial}"] = "lets the rejected attempt count"
    return Reply(shown, [terminal_views.session(shown)], [*steps.items()])


@app.command()
@command()
def index(
    resolved: Resolved,
    out: Annotated[
        Path | None, typer.Option("--out", help="HTML file to write; default: index.html in the sessions' folder.")
    ] = None,
) -> Reply:
    """Write the page of all sessions to a file: the page that `adaptsim dashboard` serves and keeps up to date.

    Example: adaptsim sessions index
    """
    from adaptsim_cli.show import index as page

    path, count = page.write(resolved.places.sessions, out)
    step = (f"xdg-open {path}", "opens the page; its links lead to the files beside it")
    return Reply({"page": str(path), "sessions": count}, [f"Sessions: {count}, {path}"], [step])


@app.command()
@command()
def verify(
    screen: Screen,
    resolved: Resolved,
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Names of sessions; without one, all of them.", autocompletion=options.session_names),
    ] = None,
) -> Reply:
    """Read every file of a session and compare it with its checksum.

    Ends with exit code 8 when a file is damaged. Nothing is changed.

    Example: adaptsim sessions verify scooping-oreo
    """
    from adaptsim_cli.errors import SessionError
    from adaptsim_cli.session import folders, keeping, terminal_views

    root = resolved.places.sessions
    if not names and (note := folders.stray_note(root)):
        screen.note(note)
    checked = []
    for name in names or folders.names(root):
        with screen.busy(f"Reading {name}"):
            checked.append(keeping.verify(root, name))
    data = {"sessions": checked}
    if not checked:
        return Reply(data, [f"No sessions yet {_begin_one(root)}"])
    damage = [message for one in checked for message in one.damage]
    if not damage:
        return Reply(data, [terminal_views.verified(checked)], [("adaptsim sessions list", "all files are intact")])
    others = f" And {len(damage) - 1} more." if len(damage) > 1 else ""
    is_open = any(one.damage and one.files > 1 for one in checked)  # else it names its own next step
    again = " A trial can be done again: adaptsim sessions redo NAME TRIAL" if is_open else ""
    failure = SessionError(f"{damage[0]}.{others}{again}")
    return Reply(data, [terminal_views.verified(checked)], failure=failure)


@app.command()
@command()
def migrate(
    screen: Screen,
    resolved: Resolved,
    name: options.Session,
    new_name: Annotated[
        str | None, typer.Option("--as", help="Name of the new session; default: NAME with -migrated.")
    ] = None,
) -> Reply:
    """Write a session of an earlier format again, so that every command can use it. The old one stays as it is.

    `report` and `--recorded` read it as it is. The log and the pages of the old one are not copied.

    Example: adaptsim sessions migrate scooping-oreo
    """
    from adaptsim_cli.session import earlier

    root, new_name = resolved.places.sessions, new_name or f"{name}-migrated"
    with screen.busy(f"Writing {new_name}"):
        folder = earlier.migrate(root, name, new_name)
    data = {"session": name, "migrated": new_name, "folder": str(folder)}
    step = (f"adaptsim sessions verify {new_name}", "compares every file with its checksum")
    return Reply(data, [f"Session {name}, written again: {folder}"], [step])


@app.command()
@command()
def mark(
    resolved: Resolved,
    name: options.Session,
    note: Annotated[str | None, typer.Option("--note", help="A note in place of an earlier one; '' for none.")] = None,
) -> Reply:
    """Write a note to a session. No record is changed.

    Example: adaptsim sessions mark scooping-oreo --note "before the camera was moved"
    """
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.session import keeping

    if note is None:
        raise UsageError("nothing to mark: add --note 'TEXT' (an empty text removes the note)")
    marked = keeping.mark(resolved.places.sessions, name, note)
    return Reply(marked, [f"{name}: {marked.note or 'no note'}"], [("adaptsim sessions list", "shows it")])


@app.command()
@command()
def delete(screen: Screen, resolved: Resolved, name: options.Session, yes: options.Sure = False) -> Reply:
    """Remove a session for good, after you type its name.

    Example: adaptsim sessions delete scooping-oreo
    """
    from adaptsim_cli.errors import StoppedByOperator
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import folders, keeping, terminal_views

    root = resolved.places.sessions
    folder = folders.folder_of(root, name)
    if folder.is_dir() and not yes:
        console.require_terminal("deleting asks for the name of the session: run in a terminal, or add --yes")
        screen.plain(f"{folder} takes {terminal_views.size(folders.size_bytes(folder))}. Deleting cannot be undone.")
        if screen.ask_text("Type the name of the session to delete it, or Enter to keep it:") != name:
            raise StoppedByOperator(f"kept: session {name} is unchanged")
    keeping.delete(root, name)
    step = ("adaptsim sessions list", "the remaining sessions")
    return Reply({"session": name, "deleted": True}, [f"Deleted: {name}"], [step])


@app.command()
@command()
def prune(
    screen: Screen,
    name: options.Session,
    rejected: Annotated[bool, typer.Option("--rejected", help="Only of attempts that do not count.")] = False,
    yes: options.Sure = False,
) -> Reply:
    """Remove the recordings of a session to make room. Records, key moments and report stay.

    Without its recordings a session can still be continued, compared and exported as a table; it cannot be replayed or
    tracked again.

    Example: adaptsim sessions prune scooping-oreo --rejected
    """
    from adaptsim_cli.errors import StoppedByOperator
    from adaptsim_cli.screen import console
    from adaptsim_cli.screen.keys import Key, agree
    from adaptsim_cli.session import keeping, terminal_views

    opened = exporting.stored(name)
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
    text = f"Removed: {what}" if room.files else f"Nothing to remove in {name}"
    return Reply(room, [text], [(f"adaptsim sessions verify {name}", "checks that every other file is intact")])


@app.command()
@command()
def redo(
    name: options.Session,
    trial: options.Trial,
    reason: Annotated[str, typer.Option("--reason", help="Why it does not count.")] = "the operator asked for a "
    "repetition",
) -> Reply:
    """Mark a trial as bad: the next run-iteration repeats it and adapts again.

    Example: adaptsim sessions redo scooping-oreo 3 --reason "the piece was touched"
    """
    from adaptsim_cli.session import correcting

    attempt = correcting.redo(exporting.stored(name), trial, reason)
    data = {"session": name, "trial": trial, "next_attempt": attempt}
    count_it = (f"adaptsim sessions accept {name} {trial}", "if it should count after all")
    again = _continues(name, "repeats it and adapts again")
    return Reply(data, [f"Trial {trial} of {name} will be done again."], [again, count_it])


@app.command()
@command()
def accept(
    name: options.Session,
    trial: options.Trial,
    attempt: Annotated[
        int | None,
        options.advanced("--attempt", "Which attempt; default: the newest with a recording.", min=1),
    ] = None,
    reason: Annotated[str, typer.Option("--reason", help="Why it counts after all.")] = "restored by the operator",
) -> Reply:
    """Take back a rejection: the attempt counts again. Nothing moves, nothing is deleted.

    Example: adaptsim sessions accept scooping-oreo 3
    """
    from adaptsim_cli.session import correcting, terminal_views

    changed = correcting.restore(exporting.stored(name), trial, None if attempt is None else attempt - 1, reason)
    return terminal_views.amended(*changed)


@app.command()
@command()
def amend(
    screen: Screen,
    resolved: Resolved,
    openers: Openers,
    name: options.Session,
    trial: options.Trial,
    outcome: Annotated[
        str | None, typer.Option("--outcome", help="The outcome that you saw, e.g. on_blade; without it you are asked.")
    ] = None,
    reason: Annotated[str, typer.Option("--reason", help="How you know.")] = "amended by the operator",
) -> Reply:
    """Set another outcome of an accepted trial, of any iteration, after looking at its recording.

    Later trials stay as they are; the next adaptation takes the new outcome into account and says so.

    Example: adaptsim sessions amend scooping-oreo 1 --outcome on_table --reason "it fell off at home"
    """
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import correcting, terminal_views
    from adaptsim_cli.session.operator import choose_amendment

    if outcome is None:
        console.require_terminal("there is no terminal to ask at: give the outcome with --outcome")
    opened = exporting.stored(name)
    task, outcomes = openers.seen_by_camera(resolved.config, opened.facts)
    record, choices = correcting.amendable(opened, task, outcomes, trial)
    chosen = choose_amendment(screen, opened, record, choices, outcome)
    return terminal_views.amended(*correcting.amend(opened, task, trial, chosen, choices[chosen], reason))


@app.command()
@command()
def policy(
    screen: Screen,
    name: options.Session,
    out: Annotated[Path | None, typer.Option("--out", help="JSON file to write; default: stdout.")] = None,
) -> Reply:
    """Export the best policy of a session: its action at contexts over the whole area, with names and units.

    `adaptsim rollout --session NAME --best` runs it.

    Example: adaptsim sessions policy scooping-oreo --out policy.json
    """
    import json

    from adaptsim_cli.screen import console
    from adaptsim_cli.session import best
    from adaptsim_cli.session.exporting import written

    if out is None:
        screen = console.Screen(as_json=True)  # stdout is for the policy alone
    with screen.busy("Training the best policy"):
        exported = best.export(exporting.stored(name))
    step = (f"adaptsim rollout --session {name} --best", "one trial with it")
    if out is None:
        screen.data("sessions policy", exported)
        return Reply()
    written(out, (json.dumps(exported, allow_nan=False, indent=1) + "\n").encode())
    return Reply(exported, [f"Policy: {out}"], [step])
