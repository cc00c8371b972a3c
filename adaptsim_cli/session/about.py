"""A person's note about a session."""

from __future__ import annotations

from pathlib import Path

from adaptsim_cli.session import records
from hw.records import Record

ABOUT = "about.json"


class About(Record):
    """about.json: a person's note. The only file of a session that is replaced."""

    note: str = ""  # free text


def about(folder: Path) -> About:
    """The note of the session in `folder`, which is empty if nobody wrote one. Raises SessionError."""
    path = folder / ABOUT
    return records.read(About, path) if path.exists() else About()
