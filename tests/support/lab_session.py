"""Runs the program itself on the simulated lab, as an operator would: in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

VOLATILE = {"timing_s", "proposal_s", "started", "created", "at", "checksums", "summary_sha256", "sealed"}

ADAPTSIM = (sys.executable, "-c", "from adaptsim_cli.commands.app import main; main()")
WORLD = """\
task = "scooping"
description = "the paper's OOD-2, seen by a small camera"
[params]
mu = 0.20
e = 5e4
g = 1
h = 2.2
[sensing]
camera = "small"
"""


def command(world: Path, *more: str) -> list[str]:
    run = ["run-iteration", "--task", "scooping", "--world", str(world), "--seed", "0", "--session", "s", "--yes"]
    return [*ADAPTSIM, *run, "--json", *more]


def environment(home: Path, **more: str) -> dict[str, str]:
    """Of a process that has this home and none of the user's settings."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("ADAPTSIM_")}
    return {**kept, "ADAPTSIM_HOME": str(home), "OMP_NUM_THREADS": "1", **more}


def run(home: Path, world: Path, *more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(world, *more), env=environment(home), capture_output=True, text=True, check=False, cwd=world.parent
    )


def run_and_kill(home: Path, world: Path, after_s: float) -> bool:
    """SIGKILL the program `after_s` after its start; False when it was done before that."""
    with subprocess.Popen(
        command(world), env=environment(home), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=world.parent
    ) as process:
        deadline = time.monotonic() + after_s
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
        return process.wait() == -signal.SIGKILL


def digest(home: Path) -> dict[str, object]:
    """All records of the first iteration of the session."""
    return digest_of(home / "data/sessions/s/iteration-01")


def digest_of(folder: Path) -> dict[str, object]:
    """Every file below `folder` by its path, without times of day and durations."""
    return {
        str(path.relative_to(folder)): _content(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    }


def _content(path: Path) -> object:
    if path.suffix == ".json":
        return steady(json.loads(path.read_text()))
    return path.exists() if path.suffix in (".html", ".toml", ".jsonl") else path.stat().st_size


def steady(value: object) -> object:
    if isinstance(value, dict):
        return {key: steady(v) for key, v in value.items() if key not in VOLATILE}
    return [steady(v) for v in value] if isinstance(value, list) else value
