"""`adaptsim sessions export` and `adaptsim replay`: trials in the formats of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adaptsim_cli.commands import completing

_Json = Annotated[bool, typer.Option("--json", help="JSON on stdout.")]


def export(
    name: Annotated[str, typer.Argument(help="Name of the session.", autocompletion=completing.sessions)],
    kind: Annotated[
        str, typer.Option("--format", autocompletion=completing.formats, help="csv, parquet, mcap, lerobot or rerun.")
    ] = "csv",
    out: Annotated[
        Path | None,
        typer.Option("--out", help="File (tables) or folder (others) to write; default: in the current folder."),
    ] = None,
    as_json: _Json = False,
) -> None:
    """Export the trials of a session: a table, MCAP files with everything, Rerun files, or a LeRobot data set.

    Parquet and LeRobot need the extra `export`, Rerun the extra `rerun`.

    Example: adaptsim sessions export scooping-oreo-adaptsim-seed0 --format mcap
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import exporting, store

    opened = store.SessionStore.open(config.load().places.sessions, name)
    screen = console.Screen(as_json=as_json)
    with screen.progress() as progress:
        path = out or Path(exporting.default_name(opened, kind))
        written = exporting.export(opened, kind, path, progress)
    if as_json:
        files = [str(file.absolute()) for file in written]
        screen.data("sessions export", {"session": name, "format": kind, "written": files})
    else:
        for file in written:
            screen.plain(str(file))
        screen.next(exporting.next_step(kind, written[0], path))


def replay(
    session: Annotated[str, typer.Argument(help="Name of the session.", autocompletion=completing.sessions)],
    trial: Annotated[int, typer.Argument(min=1, help="Number of the trial, as `sessions show` lists it.")],
    out: Annotated[Path | None, typer.Option("--out", help="Where to write the video or the Rerun file.")] = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Open it in the Rerun viewer (extra rerun).")] = False,
    as_json: _Json = False,
) -> None:
    """Watch a recorded trial: a video with the tracked centre, or the Rerun viewer with the moving arm.

    Example: adaptsim replay scooping-oreo-adaptsim-seed0 2
    """
    import subprocess
    import sys

    from adaptsim_cli import config
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import rerun_file, store, video, whole
    from adaptsim_cli.session.exporting import written

    opened = store.SessionStore.open(config.load().places.sessions, session)
    records = {record.trial: record for record in store.trials_of(opened)}
    if trial not in records:
        known = ", ".join(map(str, records)) or "none"
        raise UsageError(f"trial {trial} of {session} is not completed; completed are {known}")
    if opened.facts.curves:
        raise UsageError(f"the task {opened.facts.task} has no recordings; adaptsim report {session} shows its curves")
    screen = console.Screen(as_json=as_json)
    with screen.busy("Reading the recording"):
        found = whole.open_trial(opened, records[trial])
    with screen.busy("Writing the Rerun file" if rerun else "Drawing the video"):
        name = f"replay{'.rrd' if rerun else video.SUFFIX}"
        path = out or Path(f"{found.title}-{name}")
        written(path, (rerun_file if rerun else video).encode(found))
    if as_json:
        told = {"session": session, "trial": trial, "recording": str(found.file), "written": str(path.absolute())}
        screen.data("replay", told)
    else:
        screen.plain(str(path))
        other = (f"adaptsim sessions amend {session} {trial}", "if tracking has the wrong outcome")
        screen.next((f"{sys.executable} -m rerun {path}" if rerun else f"xdg-open {path}", "watch it"), other)
    if rerun and out is None and sys.stdout.isatty():
        subprocess.run([sys.executable, "-m", "rerun", str(path)], check=False)


def bundle(
    session: Annotated[
        str | None,
        typer.Argument(help="Name of the session; default: the newest.", autocompletion=completing.sessions),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Archive to write (.zip).")] = None,
    pictures: Annotated[bool, typer.Option("--with-pictures", help="Pack images, recordings and pages too.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an archive of that name.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="JSON on stdout.")] = False,
) -> None:
    """Pack a session for a bug report: records, versions, settings. Pictures stay out unless asked for.

    The home folder is written as ~. Look into the archive before you send it.

    Example: adaptsim bundle scooping-oreo-adaptsim-seed0
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import SessionError
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import keeping, store, terminal_views

    resolved = config.load()
    root = resolved.places.sessions
    folder = store.folder_of(root, session or store.newest(root))
    if not folder.is_dir():
        raise SessionError(f"there is no session {folder.name!r} in {root}; adaptsim sessions list names them")
    settings = {
        key: {"value": getattr(resolved.config, key), "from": source} for key, source in resolved.sources.items()
    }
    path = out or Path(f"{folder.name}-bundle.zip")
    made = keeping.bundle(folder, path, settings, pictures=pictures, force=force)
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data("bundle", {"session": folder.name, "bundle": str(made.path), "files": list(made.files)})
        return
    screen.plain(f"{made.path} ({terminal_views.size(made.path.stat().st_size)}, {len(made.files)} files)")
    if made.left_out:
        screen.plain(f"Left out: {made.left_out} files with pictures; --with-pictures packs them.")
    screen.next((f"unzip -l {made.path}", "its contents; check them before you send it"))


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
