"""Recent durations of steps, so that a wait can show its expected time."""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from adaptsim_cli.errors import SessionError
from adaptsim_cli.storage import durable
from hw.bounded import Unreadable, read_table

KEPT = 5
"""Number of durations stored per step."""
WORTH_S = 0.5
"""Shorter steps are not stored."""


@dataclass
class Durations:
    """The durations in one place, because another world or rig takes another time. A convenience, never a record."""

    file: Path
    place: str
    _known: dict[str, dict[str, list[float]]] | None = field(default=None, repr=False)

    def expected_s(self, what: str) -> float | None:
        """The median of the last durations; None if there are none."""
        last = self._here().get(_key(what))
        return statistics.median(last) if last else None

    def learn(self, what: str, took_s: float) -> None:
        """Store a duration. Does nothing if the file is not writable."""
        if took_s < WORTH_S:
            return
        last = self._here().setdefault(_key(what), [])
        last[:] = [*last, round(took_s, 1)][-KEPT:]
        with suppress(SessionError, OSError):
            durable.make_folder(self.file.parent)
            durable.replace_file(self.file, json.dumps(self._known, indent=1).encode())

    def _here(self) -> dict[str, list[float]]:
        if self._known is None:
            self._known = _read(self.file)
        return self._known.setdefault(self.place, {})


def _key(what: str) -> str:
    """The step's sentence without its numbers, which differ from time to time."""
    return re.sub(r"\d+(\.\d+)?", "#", what)


def _read(file: Path) -> dict[str, dict[str, list[float]]]:
    try:
        found = read_table(file)
    except (OSError, Unreadable):
        return {}
    return {
        place: {
            what: [float(s) for s in last if isinstance(s, int | float)]
            for what, last in things.items()
            if isinstance(last, list)
        }
        for place, things in found.items()
        if isinstance(things, Mapping)
    }
