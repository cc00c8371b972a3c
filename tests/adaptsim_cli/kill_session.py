"""Runs one toy iteration in child processes that kill themselves at a chosen durable step, and resumes each.

Prints JSON: the digest of an undisturbed session, and for every kill what was there and what it came to.
A process of its own, so that forking never meets the threads of a test run.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import jinja2  # noqa: F401 - once here instead of in every child
import numpy as np
from rich.console import Console
from toy_rig import ToyLab, opener

from adaptsim_cli import config
from adaptsim_cli.report import page
from adaptsim_cli.screen import console
from adaptsim_cli.session import conduct
from adaptsim_cli.session.store import SessionStore

VOLATILE = {"timing_s", "proposal_s", "started", "created", "at"}


def run(home: Path, kill_at: int | None = None) -> int:
    """Run in a child; returns how many durable steps it made, or -1 when it was killed."""
    counted = home.with_suffix(".steps")
    child = os.fork()
    if child == 0:
        _count_steps(counted, kill_at)
        with Path(os.devnull).open("w") as nothing:
            console.Console = lambda **_: Console(file=nothing)  # type: ignore[misc]
            request = conduct.Request(None, frozenset(), iterations=1, yes=True)
            conduct.conduct(
                config.load({"task": "toy"}, {"ADAPTSIM_HOME": str(home)}, home), request, opener(ToyLab(7)), page.write
            )
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return -1
    if status != 0:
        raise SystemExit(f"a child failed with status {status}")
    return int(counted.read_text())


def _count_steps(counted: Path, kill_at: int | None) -> None:
    """Count every fsync and rename; die just before the one chosen."""
    steps = 0

    def counting(real: object) -> object:
        def call(*arguments: object) -> object:
            nonlocal steps
            if steps == kill_at:
                os.kill(os.getpid(), signal.SIGKILL)
            steps += 1
            counted.write_text(str(steps))
            return real(*arguments)  # type: ignore[operator]

        return call

    os.fsync, os.rename = counting(os.fsync), counting(os.rename)  # type: ignore[assignment]


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
    return path.exists() if path.suffix in (".html", ".toml") else path.stat().st_size


def _steady(value: object) -> object:
    if isinstance(value, dict):
        return {key: _steady(v) for key, v in value.items() if key not in VOLATILE}
    return [_steady(v) for v in value] if isinstance(value, list) else value


def completed(home: Path) -> list[int]:
    root = home / "data" / "sessions"
    for name in [entry.name for entry in root.iterdir() if not entry.name.startswith(".")] if root.is_dir() else []:
        return sorted(key.number for key in SessionStore.open(root, name).existing().completed)
    return []


def main(root: Path, kills: int) -> None:
    whole = root / "whole"
    steps = run(whole)
    last = steps - 1  # after it the iteration has been shown: the same command would begin the next one
    chosen = sorted(np.random.default_rng(0).choice(last, size=min(kills, last), replace=False).tolist())
    outcomes = []
    for at in chosen:
        home = root / f"killed-{at}"
        killed = run(home, kill_at=at) == -1
        before = completed(home)
        run(home)
        outcomes.append({"at": at, "killed": killed, "before": before, "same": digest(home) == digest(whole)})
    sys.stdout.write(json.dumps({"steps": steps, "files": len(digest(whole)), "outcomes": outcomes}) + "\n")


main(Path(sys.argv[1]), int(sys.argv[2]))
