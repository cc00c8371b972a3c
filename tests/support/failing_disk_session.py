"""Runs one toy iteration in child processes whose disk fails at a chosen call, and then goes on with a disk that works.

A disk can fail in four ways: the process dies just before the call or just after it, the disk is full, or it cannot be
written to. Prints JSON: how many calls there are, and for every failure what was said, what was there and what it came
to. A process of its own, so that forking never meets the threads of a test run.
"""

from __future__ import annotations

import errno
import json
import os
import pathlib
import shutil
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import jinja2  # noqa: F401 - once here instead of in every child
import numpy as np
from rich.console import Console
from toy_rig import ToyLab, opener

from adaptsim_cli import config
from adaptsim_cli.errors import DiskFull, SessionError
from adaptsim_cli.report import page
from adaptsim_cli.screen import console
from adaptsim_cli.session import conduct
from adaptsim_cli.session.store import SessionStore

VOLATILE = {"timing_s", "proposal_s", "started", "created", "at", "checksums", "summary_sha256", "sealed"}
WAYS = ("killed before", "killed after", "full", "broken")


@dataclass(frozen=True)
class Failure:
    """The disk's answer to one call."""

    way: str
    at: int  # number of the call


def run(home: Path, failure: Failure | None = None) -> tuple[int | None, str]:
    """Run in a child. -> its exit status, None where it was killed; and the message with which it ended."""
    log = home.with_suffix(".log")
    child = os.fork()
    if child == 0:
        os._exit(_session(home, failure, log))
    _, status = os.waitpid(child, 0)
    killed = os.WIFSIGNALED(status)
    return None if killed else os.WEXITSTATUS(status), "" if killed else log.read_text()


def _session(home: Path, failure: Failure | None, log: Path) -> int:
    """0: done; 1: it ended with an error of the store. Anything else goes through as a traceback."""
    message = _fail(failure)
    with Path(os.devnull).open("w") as nothing:
        vars(console)["Console"] = lambda **_: Console(file=nothing)
        request = conduct.SessionRequest(None, frozenset(), iterations=1, yes=True)
        settings = config.load({"task": "toy"}, {"ADAPTSIM_HOME": str(home)}, home)
        try:
            conduct.conduct(settings, request, opener(ToyLab(7)), page.write)
        except (DiskFull, SessionError) as error:
            _say(log, f"{type(error).__name__}: {error}")
            return 1
    _say(log, str(message()))
    return 0


def _say(log: Path, text: str) -> None:
    with log.open("w") as file:
        file.write(text)


def _fail(failure: Failure | None) -> Callable[[], int]:
    """Let the disk answer the calls that change it, all but one of them properly. -> counts them."""
    calls, mkdir = 0, os.mkdir

    def counting(real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            nonlocal calls
            if real is mkdir and Path(arguments[0]).is_dir():
                return real(*arguments, **named)  # it changes nothing
            calls += 1
            if failure is None or calls - 1 != failure.at:
                return real(*arguments, **named)
            if failure.way in ("full", "broken"):
                number = errno.ENOSPC if failure.way == "full" else errno.EIO
                raise OSError(number, os.strerror(number))
            if failure.way == "killed after":
                real(*arguments, **named)
            os.kill(os.getpid(), signal.SIGKILL)
            raise AssertionError("still alive")

        return call

    for owner, name in (
        (os, "fsync"), (os, "rename"), (os, "link"), (os, "mkdir"), (pathlib.Path, "write_bytes"), (os, "ftruncate"),
    ):  # fmt: skip
        setattr(owner, name, counting(getattr(owner, name)))
    return lambda: calls


def digest(home: Path) -> dict[str, object]:
    """All that a session holds, without times of day and durations."""
    found: dict[str, object] = {}
    for path in sorted((home / "data").rglob("*")):
        if path.is_file() and not any(part.startswith(".") for part in path.relative_to(home).parts):
            name = str(path.relative_to(home))
            found[name] = _content(path)
    return found


def _content(path: Path) -> object:
    if path.suffix == ".json":
        return _steady(json.loads(path.read_text()))
    return path.exists() if path.suffix in (".html", ".toml", ".jsonl") else path.stat().st_size


def _steady(value: object) -> object:
    if isinstance(value, dict):
        return {key: _steady(v) for key, v in value.items() if key not in VOLATILE}
    return [_steady(v) for v in value] if isinstance(value, list) else value


def completed(home: Path) -> list[int]:
    root = home / "data" / "sessions"
    for name in [entry.name for entry in root.iterdir() if not entry.name.startswith(".")] if root.is_dir() else []:
        return sorted(key.number for key in SessionStore.open(root, name).existing().completed)
    return []


def main(root: Path, failures: int) -> None:
    """So many failures, or every one there is where `failures` is 0."""
    whole = root / "whole"
    calls = int(run(whole)[1])
    last = calls - 1  # after it the iteration has been shown: the same command would begin the next one
    every = [Failure(way, at) for at in range(last) for way in WAYS]
    rng = np.random.default_rng(0)
    chosen = [every[i] for i in sorted(rng.choice(len(every), failures, replace=False))] if failures else every
    outcomes = []
    for failure in chosen:
        home = root / f"{failure.way.replace(' ', '-')}-{failure.at}"
        status, message = run(home, failure)
        before = completed(home)
        again, _ = run(home)
        same = again == 0 and digest(home) == digest(whole)
        outcomes.append(
            {"way": failure.way, "at": failure.at, "status": status, "message": message, "before": before, "same": same}
        )
        shutil.rmtree(home)
    sys.stdout.write(json.dumps({"calls": calls, "files": len(digest(whole)), "outcomes": outcomes}) + "\n")


main(Path(sys.argv[1]), int(sys.argv[2]))
