"""Names: a variable is a noun of its content, and a public class has a name of its own in the whole program.

`found` or `known` says that something happened, not what the value is; two classes of one name make every search, every
import and every message ambiguous.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache

import pytest
from documents import ROOT

PACKAGES = ("hw", "perception", "calib", "sim", "adaptsim_cli")
NO_NOUNS = "found seen known told there made said asked given taken kept meant wanted afresh several"
NAMED = ast.FunctionDef | ast.AsyncFunctionDef | ast.ExceptHandler | ast.MatchAs | ast.MatchStar
KEYS = frozenset({("adaptsim_cli/screen/outputs/learning.py", "found")})  # fields of JSON, whose names are a promise


def _stored(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of everything that a module binds a value or a function to."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr
        elif isinstance(node, NAMED) and node.name is not None:
            yield node.lineno, node.name


@cache
def _trees(package: str) -> dict[str, ast.Module]:
    paths = sorted((ROOT / package).rglob("*.py"))
    return {str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in paths}


def test_every_way_of_binding_a_name_is_read() -> None:
    source = """
def f(a, *b, c=1, **d):
    e = [g for g in a]
    with a as h:
        i: int = 1
    for j, k in b:
        c.l = (m := j)
    match a:
        case [n, *o]:
            pass
    try:
        pass
    except ValueError as p:
        pass
lambda q: q
"""
    assert {name for _, name in _stored(ast.parse(source))} == set("abcdefghijklmnopq")


@pytest.mark.parametrize("package", PACKAGES)
def test_no_variable_and_no_function_is_a_bare_participle(package: str) -> None:
    no_nouns = frozenset(NO_NOUNS.split())
    offences = [
        f"{path}:{line}: {name}"
        for path, tree in _trees(package).items()
        for line, name in _stored(tree)
        if name in no_nouns and (path, name) not in KEYS
    ]
    assert not offences, "name the content instead (a row, a solution, a track):\n" + "\n".join(offences)


def test_a_public_class_has_a_name_of_its_own() -> None:
    places = defaultdict[str, list[str]](list)
    for package in PACKAGES:
        for path, tree in _trees(package).items():
            for node in ast.walk(tree):
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    places[node.name].append(f"{path}:{node.lineno}")
    shared = {name: where for name, where in places.items() if len(where) > 1}
    assert not shared, f"two public classes of one name: {shared}"
