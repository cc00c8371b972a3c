"""Remembers an unfinished motion on the disk, even if the program is killed during the motion."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from adaptsim_cli.storage import durable
from hw.bounded import Unreadable, read_table
from hw.errors import MotionRefused

CHECK = (
    "Check before anything moves: the arm stands still and touches nothing, the hand holds the tool as before, and "
    "object, table and camera have not moved"
)
_KILLED = "the program ended during the motion: it was killed, or the computer was switched off"


@dataclass(frozen=True)
class LastMotion:
    """The file `path` exists from before a motion until after its end; a stop writes its reason into it."""

    path: Path

    @contextmanager
    def moving(self) -> Iterator[None]:
        """Around one motion. Raises DiskFull or SessionError before it begins."""
        durable.make_folder(self.path.parent)
        began = datetime.now(UTC).isoformat(timespec="seconds")
        self._write(began, "")
        try:
            yield
        except MotionRefused:
            self._forget()
            raise
        except BaseException as error:
            with suppress(Exception):  # the file exists already, and this must not hide the first error
                self._write(began, str(error) or type(error).__name__)
            raise
        self._forget()

    def unended(self) -> str | None:
        """A sentence about the last motion for a person; None if the motion finished."""
        try:
            said = read_table(self.path)
        except FileNotFoundError:
            return None
        except Unreadable as error:
            return f"The last motion of this arm did not come to its end ({self.path} {error}). {CHECK}"
        why = str(said.get("stopped") or _KILLED)
        return f"The last motion of this arm, begun {said.get('began')}, did not come to its end: {why}. {CHECK}"

    def _write(self, began: str, stopped: str) -> None:
        durable.replace_file(self.path, json.dumps({"began": began, "stopped": stopped}).encode())

    def _forget(self) -> None:
        with suppress(OSError):
            self.path.unlink(missing_ok=True)
