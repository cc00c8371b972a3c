"""How much of the program each command reaches: every import counts, also those inside functions and for types alone.

A command that grows beyond its bound knows something by name that the program's entry should give it (`Openers`).
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("adaptsim_cli", "hw", "perception", "sim", "calib")
COMMANDS = "adaptsim_cli.commands."
MOST_LINES = {
    "benchmark": 37_000,
    "calibrate": 39_000,
    "checkpoints": 21_000,
    "config": 17_000,
    "dashboard": 19_000,
    "explain": 14_000,
    "exporting": 28_000,
    "find": 19_000,
    "lab": 23_000,
    "measurements": 32_000,
    "own_object": 23_000,
    "pretrain": 21_000,
    "preview": 32_000,
    "rollout": 26_000,
    "run_iteration": 27_000,
    "sessions": 29_000,
    "setup": 53_000,
    "task": 14_000,
    "touch_off": 33_000,
}
"""Of the modules that a command's module reaches, itself included."""
SHARED = {"__init__", "app", "command", "options", "rows", "settings"}
"""Modules beside the commands: `app` is the entry, which knows everything, and the others serve every command."""


@cache
def modules() -> dict[str, Path]:
    """Every module of the program."""
    files = (file for package in PACKAGES for file in (ROOT / package).rglob("*.py"))
    return {".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): f for f in files}


@cache
def imported(module: str) -> frozenset[str]:
    """The modules of the program that a module imports anywhere in its file."""
    names = _names(ast.walk(ast.parse(modules()[module].read_text(encoding="utf-8"))))
    return frozenset(names).intersection(modules())


def _names(nodes: Iterable[ast.AST]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.module and not node.level, "the program imports by whole names"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def reached(module: str) -> set[str]:
    """A module, and all that it imports, and so on."""
    closure, new = set[str](), {module}
    while new:
        closure |= new
        new = {one for module in new for one in imported(module)} - closure
    return closure


def lines(names: Iterable[str]) -> int:
    """Of all these modules together."""
    return sum(modules()[name].read_text(encoding="utf-8").count("\n") for name in names)


def test_no_command_reaches_more_than_it_needs(capsys: pytest.CaptureFixture[str]) -> None:
    sizes = {name: (len(found), lines(found)) for name in MOST_LINES if (found := reached(COMMANDS + name))}
    with capsys.disabled():
        sys.stdout.write(
            "\n"
            + "\n".join(f"{name:14} {files:4} files {size:6} lines" for name, (files, size) in sizes.items())
            + "\n"
        )
    assert _too_large({name: size for name, (_, size) in sizes.items()}) == []


def test_every_command_has_a_bound() -> None:
    folder = ROOT / "adaptsim_cli" / "commands"
    assert {file.stem for file in folder.glob("*.py")} - SHARED == set(MOST_LINES)


def test_the_loop_of_a_session_knows_no_driver_no_lab_and_no_tracker() -> None:
    loop = reached(COMMANDS + "run_iteration")
    assert "adaptsim_cli.session.flow" in loop
    behind = ("adaptsim_cli.bench.devices", "hw.camera", "sim.render", "perception.piece", "perception.bottle")
    doors = ("adaptsim_cli.session.opening", "adaptsim_cli.session.rig_target", "hw.franka.arm", "sim.lab.simulated")
    assert {name for name in loop if name.startswith(behind) or name in doors} == set()


def test_a_bound_that_is_passed_is_named() -> None:
    bound = MOST_LINES["run_iteration"]
    assert _too_large({"run_iteration": bound + 1}) == [f"run_iteration: {bound + 1} of at most {bound} lines"]


def _too_large(sizes: Mapping[str, int]) -> list[str]:
    return [
        f"{name}: {size} of at most {MOST_LINES[name]} lines" for name, size in sizes.items() if size > MOST_LINES[name]
    ]
