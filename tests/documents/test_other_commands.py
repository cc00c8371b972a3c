"""The commands of the pages that are not `adaptsim`: scripts, make and pytest name what exists."""

from __future__ import annotations

import ast
import re
import shlex
from pathlib import Path

import pytest
from documents import PAGES, ROOT, commands, read, shown

TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


def options(script: Path) -> set[str]:
    """The options that a script adds to its parser, `--help` included."""
    calls = (node for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))) if isinstance(node, ast.Call))
    added = [call for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "add_argument"]
    names = {arg.value for call in added for arg in call.args if isinstance(arg, ast.Constant)}
    return {"--help", *(str(name) for name in names)}


def wrong(line: str) -> str:
    """Why this line of a page cannot work; empty if everything that it names exists."""
    program, *words = shlex.split(line, comments=True)
    if program == "make":
        unknown = [word for word in words if "=" not in word and word not in TARGETS]
        return f"{line}: no such target: {', '.join(unknown)}" if unknown else ""
    gone = [word for word in words if re.match(r"(tests|benchmarks|docs)/\S+\.py", word)]
    gone = [word for word in gone if not (ROOT / word.partition("::")[0]).is_file()]
    if gone:
        return f"{line}: no such file: {', '.join(gone)}"
    if program == "python" and words and words[0].startswith("benchmarks/"):
        known = options(ROOT / words[0])
        unknown = [word for word in words if re.match(r"--[a-z]", word) and word.partition("=")[0] not in known]
        return f"{line}: no such option: {', '.join(unknown)}, known: {', '.join(sorted(known))}" if unknown else ""
    return ""


@pytest.mark.parametrize("page", PAGES, ids=shown)
def test_every_other_command_names_what_exists(page: Path) -> None:
    lines = [line for program in ("make", "pytest", "python") for line in commands(read(page), program)]
    assert not (found := [why for line in lines if (why := wrong(line))]), "\n".join(found)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("make tea", "no such target: tea"),
        ("pytest -q tests/nowhere.py", "no such file: tests/nowhere.py"),
        ("python benchmarks/nothing.py", "no such file"),
        ("python benchmarks/stopping.py --scops 3", "no such option: --scops"),
    ],
)
def test_a_wrong_line_is_noticed(line: str, why: str) -> None:
    (found,) = commands(f"`{line}`", line.split(maxsplit=1)[0])
    assert why in wrong(found)


def test_right_lines_pass() -> None:
    for line in ("make TORCH_INDEX=x setup", "pytest -m slow tests/e2e/test_operators_guide.py", "python -m venv x"):
        assert wrong(line) == ""
