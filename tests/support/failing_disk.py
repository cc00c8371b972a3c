"""Runs something in child processes whose disk fails at a chosen call, and then again with a disk that works.

    python failing_disk_session.py FOLDER "killed before"|"killed after"|full|broken|places|NUMBER

A way of failing: at every call. "places": in all ways, at the first and the last call that is made from each place of
the code, with all that called it. A number: so many failures, drawn from all ways and calls. The process dies just
before a call or just after it, the disk is full, or it cannot be written to. A write that fails, or before which the
process dies, has written the first half. The calls are those that change a disk: a file is created, written, flushed or
cut, gets a name or loses it, a folder is made.

Prints lines of JSON: for every failure which call it was, what was said, what had been completed, what was lost of
that, and in which files the end differs from an undisturbed one; in the end which calls there are.

A program of its own, so that forking never meets the threads of a test run. What is imported or computed once, every
child has; run it with one thread (`ONE_THREAD` of its test). Nothing is flushed in truth, because a process that dies
takes nothing with it that the system has.
"""

from __future__ import annotations

import errno
import gc
import io
import json
import os
import pathlib
import resource
import shutil
import signal
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from adaptsim_cli.errors import DiskFull, SessionError

WAYS = ("killed before", "killed after", "full", "broken")


class Scenario(Protocol):
    """Something that a person would start again after a failure, and that then goes on."""

    def run(self, home: Path) -> None:
        """Raises DiskFull, SessionError."""

    def completed(self, home: Path) -> dict[str, bytes]:
        """Every file that nothing may touch any more, as it is now."""

    def is_over(self, home: Path) -> bool:
        """Whether the same command would begin something new."""

    def digest(self, home: Path) -> Mapping[str, object]:
        """Everything in the end by file, without times of day and durations."""

    def damage(self, home: Path) -> tuple[str, ...]:
        """What the program itself finds wrong with what is stored."""


@dataclass(frozen=True)
class Failure:
    """The disk's answer to one call."""

    way: str
    at: int  # number of the call


class Disk:
    """Every call that changes something below `home`, in this process and its children."""

    def __init__(self) -> None:
        self.home = Path("/nowhere")
        self.failure: Failure | None = None
        self.calls: list[str] = []
        self.places: list[tuple[tuple[str, int], ...]] = []  # file and line of each caller
        self._real_write = pathlib.Path.write_bytes
        self._inside = False
        for owner, name in (
            (os, "rename"), (os, "replace"), (os, "link"), (os, "ftruncate"), (os, "rmdir"),
        ):  # fmt: skip
            self._watch(owner, name, lambda *_: True)
        self._watch(os, "mkdir", lambda path, *_: not Path(path).is_dir())
        self._watch(os, "unlink", lambda path, *_: os.path.lexists(path))
        self._watch(os, "open", lambda path, flags, *_: bool(flags & os.O_CREAT) and not os.path.lexists(path))
        self._watch(io, "open", lambda path, mode="r", *_: mode[0] in "wax" and not os.path.lexists(path))
        self._watch(os, "fsync", lambda *_: True, lambda _: None)
        self._watch(pathlib.Path, "write_bytes", lambda *_: True, half=self._write_half)

    def use(self, home: Path, failure: Failure | None) -> None:
        self.home, self.failure, self.calls, self.places = home, failure, [], []

    def _watch(
        self,
        owner: Any,
        name: str,
        changes: Callable[..., bool],
        real: Callable[..., Any] | None = None,
        half: Callable[..., None] = lambda *_: None,
    ) -> None:
        do = real or getattr(owner, name)

        def call(*arguments: Any, **named: Any) -> Any:
            is_part = self._inside or named.get("dir_fd") is not None  # of another call, or of removing a folder
            if is_part or not self._is_here(arguments) or not changes(*arguments):
                return do(*arguments, **named)
            self.calls.append(f"{name} {self._place(arguments[0])}")
            self.places.append(tuple((f.f_code.co_filename, line) for f, line in traceback.walk_stack(None)))
            failure = self.failure
            if failure is None or len(self.calls) - 1 != failure.at:
                return self._whole(do, arguments, named)
            self._note()
            if failure.way == "killed after":
                self._whole(do, arguments, named)
            else:
                half(*arguments)
            if failure.way in ("full", "broken"):
                number = errno.ENOSPC if failure.way == "full" else errno.EIO
                raise OSError(number, os.strerror(number))
            os.kill(os.getpid(), signal.SIGKILL)
            raise AssertionError("still alive")

        setattr(owner, name, call)

    def _whole(self, do: Callable[..., Any], arguments: Any, named: Any) -> Any:
        """One call that is not made of others."""
        self._inside = True
        try:
            return do(*arguments, **named)
        finally:
            self._inside = False

    def _write_half(self, path: Path, content: bytes) -> None:
        self._whole(self._real_write, (path, content[: len(content) // 2]), {})

    def _is_here(self, arguments: Any) -> bool:
        return isinstance(arguments[0], int) or Path(os.fsdecode(arguments[0])).is_relative_to(self.home)

    def _place(self, where: Any) -> str:
        if isinstance(where, int):
            where = Path(f"/proc/self/fd/{where}").readlink()
        return os.path.relpath(os.fsdecode(where), self.home)

    def _note(self) -> None:
        self._whole(self._real_write, (call_file(self.home), self.calls[-1].encode()), {})


def call_file(home: Path) -> Path:
    """Beside the home: which call failed."""
    return home.with_suffix(".call")


def run(scenario: Scenario, disk: Disk, home: Path, failure: Failure | None) -> tuple[int | None, str]:
    """Run in a child. -> its exit status, None where it was killed; and the message with which it ended.

    0: done; 1: it ended with an error of the store. Anything else goes through as a traceback.
    """
    log = home.with_suffix(".log")
    child = os.fork()
    if child == 0:
        disk.use(home, failure)
        status, said = 0, ""
        try:
            scenario.run(home)
        except (DiskFull, SessionError) as error:
            status, said = 1, f"{type(error).__name__}: {error}"
        log.write_text(said)
        os._exit(status)
    _, status = os.waitpid(child, 0)
    return (None, "") if os.WIFSIGNALED(status) else (os.WEXITSTATUS(status), log.read_text())


def differences(found: Mapping[str, object], wanted: Mapping[str, object]) -> dict[str, str]:
    """By file, what is not as wanted."""
    return {
        name: f"{'found' if name in found else 'missing'}: {str(found.get(name))[:300]}; "
        f"{'wanted' if name in wanted else 'not wanted'}: {str(wanted.get(name))[:300]}"
        for name in sorted(set(found) | set(wanted))
        if name not in found or name not in wanted or found[name] != wanted[name]
    }


def fail(scenario: Scenario, disk: Disk, home: Path, failure: Failure, wanted: Mapping[str, object]) -> dict[str, Any]:
    """One failure, and what comes of the same command afterwards."""
    status, message = run(scenario, disk, home, failure)
    kept = scenario.completed(home)
    again = (0, "it was over") if scenario.is_over(home) else run(scenario, disk, home, None)
    afterwards = scenario.completed(home)
    outcome = {
        "way": failure.way,
        "at": failure.at,
        "call": call_file(home).read_text() if call_file(home).exists() else "it was never made",
        "status": status,
        "message": message,
        "completed": len(kept),
        "again": again,
        "lost": [name for name, content in kept.items() if afterwards.get(name) != content],
        "different": differences(scenario.digest(home), wanted),
        "damage": scenario.damage(home),
    }
    shutil.rmtree(home)
    return outcome


def main(scenario: Scenario) -> None:
    root, which = Path(sys.argv[1]), sys.argv[2]
    disk = Disk()
    disk.use(root / "whole", None)
    scenario.run(root / "whole")  # in this process, so that every child knows what it has computed
    calls, places, wanted = disk.calls, disk.places, scenario.digest(root / "whole")
    disk.use(Path("/nowhere"), None)
    gc.freeze()
    ends = {at for place in set(places) for at in (places.index(place), len(places) - 1 - places[::-1].index(place))}
    able = sorted(ends) if which == "places" else range(len(calls))
    every = [Failure(way, at) for at in able for way in WAYS if way == which or which not in WAYS]
    rng = np.random.default_rng(0)
    chosen = sorted(rng.choice(len(every), int(which), replace=False)) if which.isdigit() else range(len(every))
    for failure in (every[i] for i in chosen):
        home = root / f"{failure.way.replace(' ', '-')}-{failure.at}"
        say(fail(scenario, disk, home, failure, wanted))
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cpu_s = sum(used.ru_utime + used.ru_stime for used in spent)
    say({"calls": calls, "places": len(set(places)), "files": len(wanted), "cpu_s": cpu_s})


def say(result: Mapping[str, Any]) -> None:
    sys.stdout.write(json.dumps(result) + "\n")
    sys.stdout.flush()
