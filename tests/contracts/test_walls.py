"""The walls around the wings hold for strings, too: a module's name in a string is an import that no checker sees."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator

from documents import ROOT

REGISTRIES = {
    "sim/adaptation/methods/__init__.py",  # methods by name
    "sim/lab/physics.py",  # physics by name
    "sim/solvers/solver.py",  # NAF
}
"""The only files that may name a module of a wing in a string: each is the registry of one kind of thing."""


def forbidden() -> Iterator[tuple[str, tuple[str, ...]]]:
    """(importing module, the modules that it must not import), of every contract about a wing."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    for contract in contracts:
        if "wing" in contract["name"]:
            for source in contract["source_modules"]:
                yield source, tuple(contract["forbidden_modules"])


def named_in(source: str, wings: tuple[str, ...]) -> set[str]:
    """The files at or below a module with a string that is the name of a module of a wing, or of something in it."""
    name = re.compile(rf"({'|'.join(map(re.escape, wings))})([.:]\w+)*")
    place = ROOT.joinpath(*source.split("."))
    files = place.rglob("*.py") if place.is_dir() else [place.with_suffix(".py")]
    return {
        str(file.relative_to(ROOT))
        for file in files
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and name.fullmatch(node.value)
    }


def test_only_a_registry_names_a_module_of_a_wing() -> None:
    walls = list(forbidden())
    assert len(walls) > 30  # the contracts were found
    assert set[str]().union(*(named_in(source, wings) for source, wings in walls)) == REGISTRIES
