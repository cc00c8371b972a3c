"""Commands on stored sessions: `report`, `compare`, `sessions export`, `replay`, `bundle`, `retrack`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply
from adaptsim_cli.session.formats import FORMATS

if TYPE_CHECKING:
    from rich.console import RenderableType

    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.session.store import SessionStore
    from adaptsim_cli.session.target import Openers


def format_names(incomplete: str) -> list[str]:
    """Formats of `sessions export` that begin like this."""
    return sorted(name for name in FORMATS if name.startswith(incomplete))


@command()
def report(
    screen: Screen,
    resolved: Resolved,
    session: options.NewestSession = None,
    out: options.Out = None,
    force: options.Force = False,
) -> Reply:
    """Write one self-contained HTML page of a session: is it better, rewards, parameters, paths, camera frames.

    A session of an earlier format has its page too.

    Example: adaptsim report scooping-oreo
    """
    import shlex

    from adaptsim_cli.screen import views
    from adaptsim_cli.session import folders
    from adaptsim_cli.session.advice import onwards
    from adaptsim_cli.session.history import results_of
    from adaptsim_cli.session.store import readable
    from adaptsim_cli.show.reports import Reports
    from adaptsim_cli.storage import durable

    root = resolved.places.sessions
    name = session or folders.newest(root)
    if out is not None:
        durable.require_new(out, force=force)
    with readable(root, name) as opened:
        with screen.busy("Drawing the report"):
            path = Reports().draw(opened, out or root / name / folders.REPORT)
        further = onwards(opened.facts, results_of(opened), opened.iterations())
    if opened.folder != root / name:
        further = ((f"adaptsim sessions migrate {name}", "writes it again for the other commands of this version"),)
    steps = [
        (f"xdg-open {shlex.quote(str(path))}", "opens it in the browser; it is a single file that you can send"),
        *further,
    ]
    steps = [step for step in steps if step[0] != f"adaptsim report {name}"]
    return Reply({"session": name, "report": str(path)}, [views.FileLine("Report", path)], steps)


@command()
def compare(
    resolved: Resolved,
    sessions: Annotated[
        list[str],
        typer.Argument(help="Names of two sessions or more, of one task.", autocompletion=options.session_names),
    ],
    out: Annotated[Path | None, typer.Option("--out", help="Folder for page and tables.")] = None,
) -> Reply:
    """Compare sessions: methods, worlds, days, posteriors. Writes a page, and CSV of the sessions and of the trials.

    Example: adaptsim compare scooping-oreo scooping-ood-1-udr
    """
    import hashlib

    from adaptsim_cli.screen import views
    from adaptsim_cli.session.hindsight import believed
    from adaptsim_cli.show import comparison

    names = tuple(dict.fromkeys(sessions))
    stores = [stored(name) for name in names]
    rows, beliefs = comparison.compared(stores), believed(stores)
    digest = hashlib.sha256("\n".join(names).encode()).hexdigest()[:8]
    name = f"{rows[0].facts.task}-{len(rows)}-sessions-{digest}"
    folder = out or resolved.places.data / "comparisons" / name
    path = comparison.write(rows, folder.absolute(), beliefs)
    data = {
        "task": rows[0].facts.task,
        "sessions": [c.as_row() for c in rows],
        "methods": comparison.by_method(rows),
        "identical": comparison.identical(rows),
        "posteriors": beliefs,
        "page": str(path),
        "tables": [str(path.with_name(name)) for name in (comparison.SESSIONS, comparison.TRIALS)],
    }
    body = [
        (c.facts.name, f"{c.iterations[0].mean:.2f}", f"{c.iterations[-1].mean:.2f}", str(len(c.trials))) for c in rows
    ]
    text: list[RenderableType] = [
        views.rows(("session", "first", "last", "trials"), body, right=(1, 2, 3)),
        "First and last: mean reward of the first and of the last iteration.",
        *comparison.repetitions(rows),
        *comparison.conclusions(rows),
        *comparison.disagreements(beliefs),
        views.FileLine("Page", path),
    ]
    return Reply(data, text, [(f"xdg-open {path}", "the page, in the browser")])


@command()
def export(
    screen: Screen,
    name: options.Session,
    kind: Annotated[
        str,
        typer.Option(
            "--format",
            autocompletion=format_names,
            help=f"{', '.join(FORMATS)}.",
        ),
    ] = "csv",
    out: Annotated[
        Path | None,
        typer.Option("--out", help="File (tables) or folder (others) to write; default: in the current folder."),
    ] = None,
) -> Reply:
    """Export a session: its trials as a table, MCAP, Rerun or LeRobot, or its adapted scene for Drake or MuJoCo.

    ranges writes the posterior as randomisation ranges, with snippets for Drake, MuJoCo Playground and Isaac Lab.
    sdf and mjcf write the scene at the posterior mean with one trial of the best policy. Parquet and LeRobot need the
    extra `export`, Rerun the extra `rerun`, mjcf the extra `mujoco`.

    Example: adaptsim sessions export scooping-oreo --format mcap
    """
    from adaptsim_cli.session import formats
    from adaptsim_cli.session.best_scene import scene_files

    opened = stored(name)
    path = out or Path(formats.default_name(opened, kind))
    with screen.progress() as progress:
        written = formats.export(opened, kind, path, scene_files, progress)
    files = [str(file.absolute()) for file in written]
    data = {"session": name, "format": kind, "written": files}
    return Reply(data, [str(file) for file in written], [FORMATS[kind].next_step(written[0], path)])


@command()
def replay(
    screen: Screen,
    session: options.Session,
    trial: options.Trial,
    out: options.Out = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Open it in the Rerun viewer (extra rerun).")] = False,
) -> Reply:
    """Watch a recorded trial: a video with the tracked centre, or the Rerun viewer with the moving arm.

    Example: adaptsim replay scooping-oreo 2
    """
    import subprocess
    import sys

    from adaptsim_cli.session import history, replaying
    from adaptsim_cli.session.exporting import written

    opened = stored(session)
    record = history.completed(opened, trial)
    with screen.busy("Reading the recording"):
        stored_trial = replaying.open_trial(opened, record)
    with screen.busy("Writing the Rerun file" if rerun else "Drawing the video"):
        path = out or Path(f"{stored_trial.title}-replay{'.rrd' if rerun else replaying.VIDEO}")
        written(path, (replaying.rerun_file if rerun else replaying.video)(stored_trial))
    data = {"session": session, "trial": trial, "recording": str(stored_trial.file), "written": str(path.absolute())}
    screen.plain(str(path))
    if rerun and out is None and sys.stdout.isatty():
        subprocess.run([sys.executable, "-m", "rerun", str(path)], check=False)
    steps = [
        (f"{sys.executable} -m rerun {path}" if rerun else f"xdg-open {path}", "watch it"),
        (f"adaptsim sessions amend {session} {trial}", "if tracking has the wrong outcome"),
    ]
    return Reply(data, next=steps)


@command()
def bundle(
    resolved: Resolved,
    session: options.NewestSession = None,
    out: Annotated[Path | None, typer.Option("--out", help="Archive to write (.zip).")] = None,
    pictures: Annotated[bool, typer.Option("--with-pictures", help="Pack images, recordings and pages too.")] = False,
    force: options.Force = False,
) -> Reply:
    """Pack a session for a bug report: records, versions, settings. Pictures stay out unless asked for.

    The home folder is written as ~. Look into the archive before you send it.

    Example: adaptsim bundle scooping-oreo
    """
    from adaptsim_cli.errors import SessionError
    from adaptsim_cli.session import folders, keeping, terminal_views

    root = resolved.places.sessions
    folder = folders.folder_of(root, session or folders.newest(root))
    if not folder.is_dir():
        raise SessionError(f"there is no session {folder.name!r} in {root}; adaptsim sessions list names them")
    settings = {
        key: {"value": getattr(resolved.config, key), "from": source} for key, source in resolved.sources.items()
    }
    path = out or Path(f"{folder.name}-bundle.zip")
    files, left_out = keeping.bundle(folder, path, settings, pictures=pictures, force=force)
    text = [f"{path.absolute()} ({terminal_views.size(path.stat().st_size)}, {len(files)} files)"]
    if left_out:
        text.append(f"Left out: {left_out} files with pictures; --with-pictures packs them.")
    data = {"session": folder.name, "bundle": str(path.absolute()), "files": list(files)}
    return Reply(data, text, [(f"unzip -l {path}", "its contents; check them before you send it")])


@command()
def retrack(
    screen: Screen,
    openers: Openers,
    session: options.Session,
    trial: Annotated[
        int | None, typer.Option("--trial", min=1, help="Number of one trial, as `sessions show` lists it.")
    ] = None,
) -> Reply:
    """Track the recordings of a session again, with the tracker of this version. Nothing stored is changed.

    Example: adaptsim retrack scooping-oreo --trial 2
    """
    from adaptsim_cli.screen import views
    from adaptsim_cli.session import retracking
    from sim.tasks import get_task

    opened = stored(session)
    task = get_task(opened.facts.task)
    retracking.require_camera(task)
    with screen.busy("Tracking"):
        rows = tuple(retracking.retrack(opened, task, openers.tracker(task), trial))
    return Reply(
        {"session": session, "units": opened.facts.units, "trials": rows},
        [views.rows(retracking.HEAD, retracking.rows(rows), right=(0, 3, 4, 5, 6))],
        retracking.next_steps(session, rows),
        retracking.failure(rows),
    )


def stored(name: str | None) -> SessionStore:
    """The session with this name, or the newest. Raises SessionError, UsageError."""
    from adaptsim_cli import config
    from adaptsim_cli.session import folders, store

    root = config.load().places.sessions
    return store.SessionStore.open(root, name or folders.newest(root))
