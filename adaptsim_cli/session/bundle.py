"""The parts of a session for a bug report, in one archive: records, versions, settings. Pictures only on request."""

from __future__ import annotations

import json
import platform
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from io import BytesIO
from pathlib import Path

from adaptsim_cli.session.store import entries
from adaptsim_cli.storage import durable

TEXT = (".json", ".toml", ".jsonl")
PICTURES = (".jpg", ".mcap", ".html")
"""Files that show a lab: images, recordings, and pages with images."""


@dataclass(frozen=True)
class Bundled:
    """A written archive."""

    path: Path
    files: tuple[str, ...]
    left_out: int  # number of files with pictures


def bundle(folder: Path, out: Path, settings: Mapping[str, object], *, pictures: bool = False) -> Bundled:
    """Write the archive `out` (.zip) of the session in `folder`, damaged or not. Raises SessionError, DiskFull.

    Folder names above the session are left out, because they may name a person.
    """
    chosen, left_out = list[Path](), 0
    for path in _files(folder):
        if path.suffix in TEXT or pictures:
            chosen.append(path)
        elif path.suffix in PICTURES:
            left_out += 1
    about = {
        "session": folder.name,
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "packages": dict(sorted(_packages())),
        "settings": settings,
        "left_out_pictures": left_out,
    }
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("about.json", _anonymous(json.dumps(about, indent=1, default=str)))
        for path in chosen:
            name = f"{folder.name}/{path.relative_to(folder)}"
            with durable.explained(path):
                content = path.read_bytes()
            archive.writestr(name, _anonymous(content.decode()).encode() if path.suffix in TEXT else content)
        names = tuple(archive.namelist())
    durable.make_folder(out.absolute().parent)
    durable.replace_file(out.absolute(), stream.getvalue())
    return Bundled(out.absolute(), names, left_out)


def _files(folder: Path) -> list[Path]:
    """Every file in `folder`, without leftovers and the files of solvers."""
    found = []
    for entry in entries(folder):
        if entry.is_dir():
            found += _files(entry) if entry.name != "naf" else []
        else:
            found.append(entry)
    return found


def _anonymous(text: str) -> str:
    """Replace the user's home folder by ~."""
    return text.replace(str(Path.home()), "~") if len(str(Path.home())) > 1 else text


def _packages() -> set[tuple[str, str]]:
    return {(dist.metadata["Name"], dist.version) for dist in metadata.distributions() if dist.metadata["Name"]}
