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
