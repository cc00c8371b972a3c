"""Notices whether the code of a task's file does more than compute, for example prints, sleeps or reads the clock."""

from __future__ import annotations

import builtins
import io
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from typing import Any

from sim.tasks.files import caller_line, confine, patched

_LONGEST_S = 0.05
"""A sleep is cut to this while it is watched."""


@dataclass(frozen=True)
class Watched:
    """The lines of a task file that printed, slept or started a process."""

    path: str
    lines: dict[str, list[int]] = field(default_factory=dict)  # what -> lines

    def note(self, what: str) -> None:
        """Note the line of the file that runs now, if one does."""
        line = caller_line(self.path)
        if line is not None and line not in self.lines.setdefault(what, []):
            self.lines[what].append(line)

    def sentences(self) -> Iterator[tuple[str, str]]:
        """(what, sentence with the lines) for each thing that was noted."""
        for what, lines in self.lines.items():
            where = ", ".join(map(str, sorted(lines)[:5]))
            yield what, f"{self.path}, line{'s' * (len(lines) > 1)} {where} {what}"


PRINTS = "prints"
SLEEPS = "sleeps"
STARTS = "starts a process"
READS_CLOCK = "reads the clock"
MOVES = "changes the current folder"
_CLOCKS = ("time", "time_ns", "monotonic", "perf_counter")


@contextmanager
def watched(path: str) -> Iterator[Watched]:
    """Record the actions of the file during a block. It cannot end or double this process then, and its output goes to
    stderr.
    """
    notes = Watched(path)

    class Aside(io.TextIOBase):
        def write(self, text: str) -> int:
            notes.note(PRINTS)
            return sys.stderr.write(text)

    def printing(*words: object, _original: Callable[..., None] = builtins.print, **options: Any) -> None:
        notes.note(PRINTS)
        _original(*words, **options)

    def sleep(seconds: float, _original: Callable[[float], None] = time.sleep) -> None:
        if sys._getframe(1).f_code.co_filename == path:
            notes.note(SLEEPS)
            seconds = min(seconds, _LONGEST_S)
        _original(seconds)

    def noting(what: str, original: Callable[..., Any]) -> Callable[..., Any]:
        def noted(*arguments: Any, **options: Any) -> Any:
            if sys._getframe(1).f_code.co_filename == path:
                notes.note(what)
            return original(*arguments, **options)

        return noted

    confine(path)
    starts = {name: noting(STARTS, getattr(subprocess, name)) for name in ("run", "check_output", "call", "check_call")}
    with (
        patched(builtins, {"print": printing}),
        patched(time, {"sleep": sleep, **{name: noting(READS_CLOCK, getattr(time, name)) for name in _CLOCKS}}),
        patched(subprocess, starts),
        patched(subprocess.Popen, {"__init__": noting(STARTS, subprocess.Popen.__init__)}),
        patched(os, {"system": noting(STARTS, os.system), "chdir": noting(MOVES, os.chdir)}),
        redirect_stdout(Aside()),
    ):
        yield notes
