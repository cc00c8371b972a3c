"""The pages that a reader finds, as Markdown, the commands in them, and the contracts that their code keeps."""

from __future__ import annotations

import importlib.util
import inspect
import json
import re
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import typer

from adaptsim_cli.commands import app
from sim import tasks

ROOT = Path(__file__).parents[2]
PAGES = (
    *sorted(ROOT.glob("*.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "docs").rglob("*.ipynb")),
)
FENCE = re.compile(r"^( *)```(.*?)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
PROGRAM: typer.core.TyperGroup = typer.main.get_command(app.app)  # type: ignore[assignment]
MARKED = re.compile(r"^<!-- (\w+) (\S+) -->\n```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OF_THE_PROGRAM = {"--help", "--install-completion", "--show-completion"}
"""Options that act while the line is parsed: nothing is installed by a test."""
NUMBERS = {"WIDTH", "N", "TRIAL"}
"""Placeholders that stand for a number."""
_PREFIX = re.compile(r"^(?:\$ )?(?:[A-Z][A-Z0-9_]*=\S* )*")


def shown(page: Path) -> str:
    """The path of a page within the repository."""
    return str(page.relative_to(ROOT))


def read(page: Path) -> str:
    """A page as Markdown. The code cells of a notebook become fences."""
    text = page.read_text(encoding="utf-8")
    if page.suffix != ".ipynb":
        return text
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(text)["cells"]]
    return "\n\n".join(f"```python\n{source}\n```" if kind == "code" else source for kind, source in cells) + "\n"


def marked(page: str) -> list[tuple[str, str, str]]:
    """(kind, path, code) of the marked code of a page of docs, in order."""
    return MARKED.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))


def code_in(page: str, language: str) -> list[str]:
    """The code blocks in a language of a page of the repository, in order."""
    fences = FENCE.findall((ROOT / page).read_text(encoding="utf-8"))
    return [code for _, name, code in fences if name == language]


def commands(text: str, program: str = "adaptsim") -> list[str]:
    """Every call of `program` in a page: lines of its code blocks, fenced or indented, and spans within its prose."""
    blocks = [line for match in FENCE.finditer(text) for line in match[3].splitlines()]
    prose = FENCE.sub("", text)
    blocks += [line for line in prose.splitlines() if line.startswith("    ")]
    spans = [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose)]
    lines = [_PREFIX.sub("", line.strip()) for line in (*blocks, *spans)]
    return [line for line in lines if line == program or line.startswith(f"{program} ")]


def every_command(node: typer.core.TyperGroup = PROGRAM, name: str = "adaptsim") -> Iterator[tuple[str, Any]]:
    """(name, command) of all at or under `node`, without its groups."""
    for word, command in node.commands.items():
        if isinstance(command, typer.core.TyperGroup):
            if command.invoke_without_command:
                yield f"{name} {word}", command
            yield from every_command(command, f"{name} {word}")
        else:
            yield f"{name} {word}", command


def parse(line: str) -> dict[str, object]:
    """The parameters of the command that the line names, nothing executed. Raises TyperException.

    A line that only names a command need not give what the command requires.
    """
    node = PROGRAM
    words = ["1" if word in NUMBERS else word for word in shlex.split(line, comments=True)[1:]]
    context = node.make_context("adaptsim", [], resilient_parsing=True)
    while words and not words[0].startswith("-") and isinstance(node, typer.core.TyperGroup):
        context.resilient_parsing = False  # a command that is not there raises
        name, command, words = node.resolve_command(context, words)
        assert command is not None
        context = command.make_context(name, [], parent=context, resilient_parsing=True)
        node = command  # type: ignore[assignment]
    if not words or OF_THE_PROGRAM & set(words):
        return {}
    return dict(node.make_context(node.name, words, parent=context.parent).params)


def module(path: Path) -> ModuleType:
    """The module of a file, made anew."""
    spec = importlib.util.spec_from_file_location(f"loaded_{path.parent.name}_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = made
    spec.loader.exec_module(made)
    return made


def require_kept(contract: ModuleType, **given: Any) -> None:
    """Run the tests of a contract that take these arguments and no others."""
    tests: list[Callable[..., None]] = [
        test
        for name, test in vars(contract).items()
        if name.startswith("test_") and list(inspect.signature(test).parameters) == list(given)
    ]
    assert len(tests) >= 4
    for test in tests:
        test(**given)


def install(folder: Path, package: str, offered: Mapping[str, str], group: str = tasks.REGISTRY.group) -> None:
    """Metadata in `folder` as of an installed package that offers these tasks, or members of another group."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir()
    lines = [f"[{group}]", *(f"{name} = {value}" for name, value in offered.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n", encoding="utf-8")


def install_from(page: str, folder: Path, group: str, names: tuple[str, ...] = ("",)) -> None:
    """Write the marked files of a page of docs whose paths begin with one of `names`, and install them as a package."""
    for kind, path, code in marked(page):
        if kind == "file" and path.startswith(names):
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(code, encoding="utf-8")
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    install(folder, project["name"], project["entry-points"][group], group)
