"""`adaptsim bundle`: a session for a bug report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adaptsim_cli.commands import completing


def bundle(
    session: Annotated[
        str | None,
        typer.Argument(help="Name of the session; default: the newest.", autocompletion=completing.sessions),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Archive to write (.zip).")] = None,
    pictures: Annotated[bool, typer.Option("--with-pictures", help="Pack images, recordings and pages too.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="JSON on stdout.")] = False,
) -> None:
    """Pack a session for a bug report: records, versions, settings. Pictures stay out unless asked for.

    The home folder is written as ~. Look into the archive before you send it.

    Example: adaptsim bundle scooping-oreo-adaptsim-seed0
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import SessionError
    from adaptsim_cli.screen import console
    from adaptsim_cli.session import keeping, shows, store

    resolved = config.load()
    root = resolved.places.sessions
    folder = store.folder_of(root, session or store.newest(root))
    if not folder.is_dir():
        raise SessionError(f"there is no session {folder.name!r} in {root}; adaptsim sessions list names them")
    settings = {
        key: {"value": getattr(resolved.config, key), "from": source} for key, source in resolved.sources.items()
    }
    path = out or Path(f"{folder.name}-bundle.zip")
    made = keeping.bundle(folder, path, settings, pictures=pictures)
    screen = console.Screen(as_json=as_json)
    if as_json:
        screen.data("bundle", {"session": folder.name, "bundle": str(made.path), "files": list(made.files)})
        return
    screen.plain(f"{made.path} ({shows.size(made.path.stat().st_size)}, {len(made.files)} files)")
    if made.left_out:
        screen.plain(f"Left out: {made.left_out} files with pictures; --with-pictures packs them.")
    screen.next((f"unzip -l {made.path}", "its contents; check them before you send it"))
