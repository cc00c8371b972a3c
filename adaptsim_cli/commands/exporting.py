"""Commands on stored sessions: `report`, `compare`, `sessions export`, `replay`, `bundle`, `retrack`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adaptsim_cli import options
from adaptsim_cli.session.formats import FORMATS


def report(
    session: options.NewestSession = None,
    out: options.Out = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Write one self-contained HTML page of a session: is it better, rewards, parameters, paths, camera frames.

    Example: adaptsim report scooping-oreo
    """
    import shlex

    from adaptsim_cli.screen import console
    from adaptsim_cli.storage import durable
    from adaptsim_cli.wiring.hindsight import Reports

    opened, screen = options.stored(session), console.Screen(as_json=as_json)
    if out is not None:
        durable.require_new(out, force=force)
    with screen.busy("Drawing the report"):
        path = Reports().draw(opened, out)
    name = opened.facts.name
    if not screen.data("report", {"session": name, "report": str(path)}):
        screen.plain(f"Report: {path}")
        screen.next(
            (f"xdg-open {shlex.quote(str(path))}", "opens it in the browser; it is a single file that you can send"),
            (f"adaptsim run-iteration --session {name}", "continues the session"),
        )


def compare(
    sessions: Annotated[
        list[str],
        typer.Argument(help="Names of two sessions or more, of one task.", autocompletion=options.session_names),
    ],
    out: Annotated[Path | None, typer.Option("--out", help="Folder for page and tables.")] = None,
    as_json: options.Json = False,
) -> None:
    """Compare sessions: methods, worlds, days, posteriors. Writes a page, and CSV of the sessions and of the trials.

    Example: adaptsim compare scooping-oreo scooping-ood-1-udr
    """
    import hashlib

    from adaptsim_cli import config
    from adaptsim_cli.report import comparison
    from adaptsim_cli.screen import console, views
    from adaptsim_cli.wiring.hindsight import believed

    names = tuple(dict.fromkeys(sessions))
    stores = [options.stored(name) for name in names]
    rows, beliefs = comparison.compared(stores), believed(stores)
    digest = hashlib.sha256("\n".join(names).encode()).hexdigest()[:8]
    name = f"{rows[0].facts.task}-{len(rows)}-sessions-{digest}"
    folder = out or config.load().places.data / "comparisons" / name
    path = comparison.write(rows, folder.absolute(), beliefs)
    screen = console.Screen(as_json=as_json)
    data = {
        "task": rows[0].facts.task,
        "sessions": [c.as_row() for c in rows],
        "methods": comparison.by_method(rows),
        "identical": comparison.identical(rows),
        "posteriors": beliefs,
        "page": str(path),
        "tables": [str(path.with_name(name)) for name in (comparison.SESSIONS, comparison.TRIALS)],
    }
    if screen.data("compare", data):
        return
    body = [
        (c.facts.name, f"{c.iterations[0].mean:.2f}", f"{c.iterations[-1].mean:.2f}", str(len(c.trials))) for c in rows
    ]
    screen.show(views.rows(("session", "first", "last", "trials"), body, right=(1, 2, 3)))
    screen.plain("First and last: mean reward of the first and of the last iteration.")
    for sentence in (
        *comparison.repetitions(rows),
        *comparison.conclusions(rows),
        *comparison.disagreements(beliefs),
    ):
        screen.plain(sentence)
    screen.plain(f"Page: {path}")
    screen.next((f"xdg-open {path}", "the page, in the browser"))


def export(
    name: options.Session,
    kind: Annotated[
        str,
        typer.Option(
            "--format",
            autocompletion=options.export_formats,
            help=f"{', '.join(FORMATS)}.",
        ),
    ] = "csv",
    out: Annotated[
        Path | None,
        typer.Option("--out", help="File (tables) or folder (others) to write; default: in the current folder."),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Export a session: its trials as a table, MCAP, Rerun or LeRobot, or its adapted scene for Drake or MuJoCo.

    ranges writes the posterior as randomisation ranges, with snippets for Drake, MuJoCo Playground and Isaac Lab.
    sdf and mjcf write the scene at the posterior mean with one trial of the best policy. Parquet and LeRobot need the
    extra `export`, Rerun the extra `rerun`, mjcf the extra `mujoco`.

    Example: adaptsim sessions export scooping-oreo --format mcap
    """
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import formats
    from adaptsim_cli.wiring.best import scene_files

    opened, screen = options.stored(name), console.Screen(as_json=as_json)
    path = out or Path(formats.default_name(opened, kind))
    with screen.progress() as progress:
        written = formats.export(opened, kind, path, scene_files, progress)
    files = [str(file.absolute()) for file in written]
    if not screen.data("sessions export", {"session": name, "format": kind, "written": files}):
        for file in written:
            screen.plain(str(file))
        screen.next(FORMATS[kind].next_step(written[0], path))


def replay(
    session: options.Session,
    trial: options.Trial,
    out: options.Out = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Open it in the Rerun viewer (extra rerun).")] = False,
    as_json: options.Json = False,
) -> None:
    """Watch a recorded trial: a video with the tracked centre, or the Rerun viewer with the moving arm.

    Example: adaptsim replay scooping-oreo 2
    """
    import subprocess
    import sys

    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import history, replaying
    from adaptsim_cli.session.exporting import written

    opened, screen = options.stored(session), console.Screen(as_json=as_json)
    record = history.completed(opened, trial)
    if opened.facts.curves:
        raise UsageError(f"the task {opened.facts.task} has no recordings; adaptsim report {session} shows its curves")
    with screen.busy("Reading the recording"):
        stored_trial = replaying.open_trial(opened, record)
    with screen.busy("Writing the Rerun file" if rerun else "Drawing the video"):
        path = out or Path(f"{stored_trial.title}-replay{'.rrd' if rerun else replaying.VIDEO}")
        written(path, (replaying.rerun_file if rerun else replaying.video)(stored_trial))
    data = {"session": session, "trial": trial, "recording": str(stored_trial.file), "written": str(path.absolute())}
    if not screen.data("replay", data):
        screen.plain(str(path))
        other = (f"adaptsim sessions amend {session} {trial}", "if tracking has the wrong outcome")
        screen.next((f"{sys.executable} -m rerun {path}" if rerun else f"xdg-open {path}", "watch it"), other)
    if rerun and out is None and sys.stdout.isatty():
        subprocess.run([sys.executable, "-m", "rerun", str(path)], check=False)


def bundle(
    session: options.NewestSession = None,
    out: Annotated[Path | None, typer.Option("--out", help="Archive to write (.zip).")] = None,
    pictures: Annotated[bool, typer.Option("--with-pictures", help="Pack images, recordings and pages too.")] = False,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Pack a session for a bug report: records, versions, settings. Pictures stay out unless asked for.

    The home folder is written as ~. Look into the archive before you send it.

    Example: adaptsim bundle scooping-oreo
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import SessionError
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import folders, keeping, terminal_views

    resolved = config.load()
    root = resolved.places.sessions
    folder = folders.folder_of(root, session or folders.newest(root))
    if not folder.is_dir():
        raise SessionError(f"there is no session {folder.name!r} in {root}; adaptsim sessions list names them")
    settings = {
        key: {"value": getattr(resolved.config, key), "from": source} for key, source in resolved.sources.items()
    }
    path = out or Path(f"{folder.name}-bundle.zip")
    files, left_out = keeping.bundle(folder, path, settings, pictures=pictures, force=force)
    screen = console.Screen(as_json=as_json)
    if screen.data("bundle", {"session": folder.name, "bundle": str(path.absolute()), "files": list(files)}):
        return
    screen.plain(f"{path.absolute()} ({terminal_views.size(path.stat().st_size)}, {len(files)} files)")
    if left_out:
        screen.plain(f"Left out: {left_out} files with pictures; --with-pictures packs them.")
    screen.next((f"unzip -l {path}", "its contents; check them before you send it"))


def retrack(
    session: options.Session,
    trial: Annotated[
        int | None, typer.Option("--trial", min=1, help="Number of one trial, as `sessions show` lists it.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Track the recordings of a session again, with the tracker of this version. Nothing stored is changed.

    Example: adaptsim retrack scooping-oreo --trial 2
    """
    from adaptsim_cli.devices.trackers import tracker_of
    from adaptsim_cli.screen import console, views
    from adaptsim_cli.session import retracking
    from sim.tasks import get_task

    opened, screen = options.stored(session), console.Screen(as_json=as_json)
    task = get_task(opened.facts.task)
    retracking.require_camera(task)
    with screen.busy("Tracking"):
        rows = tuple(retracking.retrack(opened, task, tracker_of(task), trial))
    if not screen.data("retrack", {"session": session, "units": opened.facts.units, "trials": rows}):
        screen.show(views.rows(retracking.HEAD, retracking.rows(rows), right=(0, 3, 4, 5, 6)))
        screen.next(*retracking.next_steps(session, rows))
    retracking.require_tracked(rows)
