"""The log of a command: its steps, questions and answers, one line of JSON each."""

from __future__ import annotations

import json
import os
from datetime import UTC, datetime
from pathlib import Path
from threading import RLock
from typing import Any, Literal

from pydantic import Field

from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.storage import durable
from hw.bounded import JSON_BYTES, parse_table, read_bytes
from hw.records import Record, from_any_version

FILE = "log.jsonl"


Kind = Literal["begun", "asked", "answered", "done", "noted", "planned", "tracked", "stored", "reported", "ended"]


class LogLine(Record):
    """One line of log.jsonl."""

    at: str  # ISO 8601, to the millisecond
    event: Kind  # kind of event
    text: str = ""  # the sentence on the screen: question, step, warning, error
    took_s: float | None = None  # duration of the step or of the answer
    data: dict[str, Any] = Field(default_factory=dict)  # further values, by name, in units


class CommandLog:
    """`Listener` that writes each call as a line of the log in a folder."""

    def __init__(self, folder: Path, screen: Screen) -> None:
        self._path, self._screen, self._is_failing = folder / FILE, screen, False
        self._lock = RLock()  # a report is drawn in another thread
        self._is_torn = _is_torn(self._path)

    def doing(self, what: str, stage: str) -> None:
        """See `Listener`; the step becomes a line once it is over."""

    def did(self, what: str, stage: str, took_s: float) -> None:
        """See `Listener`."""
        self.write("done", what, took_s, stage=stage)

    def asking(self, question: str) -> None:
        """See `Listener`."""
        self.write("asked", question)

    def answered(self, question: str, answer: str, took_s: float) -> None:
        """See `Listener`."""
        self.write("answered", question, took_s, answer=answer)

    def noted(self, text: str) -> None:
        """See `Listener`."""
        self.write("noted", text)

    def write(self, event: Kind, text: str = "", took_s: float | None = None, **data: Any) -> None:
        """Append one line. If that fails, the session continues, and the screen says so once; it is silent until a line
        has succeeded again.
        """
        at = datetime.now(UTC).isoformat(timespec="milliseconds")
        took_s = None if took_s is None else round(took_s, 3)
        with self._lock:
            self._add(LogLine(at=at, event=event, text=text, took_s=took_s, data=data))

    def _add(self, line: LogLine) -> None:
        try:
            with durable.explained(self._path):
                _append(self._path, ("\n" if self._is_torn else "") + _as_line(line))
            self._is_torn = self._is_failing = False
        except SessionError as error:
            self._is_torn, was_failing, self._is_failing = _is_torn(self._path), self._is_failing, True
            if not was_failing:
                self._screen.note(f"The session goes on without this line of its log: {error}")


def read(folder: Path) -> tuple[LogLine, ...]:
    """The log of the session in `folder`, oldest line first; empty without a log.

    Truncated lines are skipped. Raises Unreadable for a file larger than any log can be, OSError.
    """
    path = folder / FILE
    if not path.is_file():
        return ()
    lines = []
    for line in read_bytes(path, JSON_BYTES).splitlines():
        try:
            lines.append(from_any_version(LogLine, parse_table(line, is_toml=False)))
        except ValueError:
            continue
    return tuple(lines)


def _as_line(line: LogLine) -> str:
    return json.dumps(line.model_dump(mode="json", exclude_defaults=True)) + "\n"


def _append(path: Path, text: str) -> None:
    """Append a line whole or not at all."""
    fd = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        os.write(fd, text.encode())
    finally:
        os.close(fd)


def _is_torn(path: Path) -> bool:
    """Whether the last line is truncated."""
    try:
        with path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            return file.read(1) != b"\n"
    except OSError:  # missing, or empty
        return False
