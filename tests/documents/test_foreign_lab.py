"""The foreign lab shares no code with the product: only the program that it is offered to imports ours."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

LAB = Path(__file__).parents[2] / "benchmarks" / "foreign_lab"
OURS = {"adaptsim_cli", "calib", "hw", "perception", "sim"}
OFFERED_TO = "program.py"


def imported(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add((node.module or "").partition(".")[0])
    return found


@pytest.mark.parametrize("path", sorted(LAB.glob("*.py")), ids=lambda path: path.name)
def test_only_the_program_imports_ours(path: Path) -> None:
    assert bool(imported(path) & OURS) == (path.name == OFFERED_TO)


def test_there_is_a_lab() -> None:
    assert {"arm.py", "camera.py", "world.py", OFFERED_TO} <= {path.name for path in LAB.glob("*.py")}
