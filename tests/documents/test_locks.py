"""The two lists of exact versions: what the program runs with, and everything."""

from __future__ import annotations

import re
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
NOT_FROZEN = {"setuptools"}  # pip leaves it out of what it freezes


def locked(name: str) -> dict[str, str]:
    lines = (ROOT / name).read_text().splitlines()
    return {canonicalize_name(re.split("==", line)[0]): line for line in lines if not line.startswith("#")}


def needed(wanted: list[str]) -> set[str]:
    """Names of packages, and of what they need in turn, as their installed metadata say."""
    names, todo = set[str](), [Requirement(text) for text in wanted]
    while todo:
        one = todo.pop()
        name = canonicalize_name(one.name)
        if name in names or (one.marker is not None and not one.marker.evaluate({"extra": ""})):
            continue
        names.add(name)
        todo += [Requirement(text) for text in metadata.requires(name) or []]
    return names


def test_what_the_program_runs_with_is_a_part_of_everything() -> None:
    run, everything = locked("requirements-run.lock"), locked("requirements.lock")
    assert run.items() <= everything.items()
    assert not run.keys() & {"mujoco", "pin", "sbi", "botorch", "pytest", "mypy", "ruff", "distributed"}


def test_it_holds_all_that_the_program_needs() -> None:
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    assert needed(wanted) - NOT_FROZEN <= locked("requirements-run.lock").keys()
