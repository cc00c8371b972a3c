"""Troubleshooting by message, from the `raise` statements of every documented error."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from collections.abc import Iterator

from adaptsim_cli.commands import app
from pages import PACKAGES, ROOT

Entry = tuple[str, str]

MESSAGES_HEAD = """# Troubleshooting by message

Written by `make docs` from the errors that the program raises. Search this page for a part of the message that you see; `…` stands
for a value. Most messages end with the next step; the same command continues the session. What to do beside the arm: [When something goes
wrong](faults.md). What tasks, rollouts, training and benchmarks say: [messages for developers](developer-messages.md).

The exit code of a command tells the kind of error:

| exit code | errors |
|---|---|
"""

DEVELOPERS_HEAD = """# Messages for developers

Written by `make docs` from the errors that tasks, rollouts, training and benchmarks raise: what somebody meets who adds a task or a
method, or compares them. What an operator meets: [troubleshooting by message](troubleshooting.md).

| exit code | errors |
|---|---|
"""

DEVELOPERS = (
    "sim/adaptation",
    "sim/research",
    "sim/rollouts",
    "sim/solvers",
    "sim/storage",
    "sim/tasks",
    "adaptsim_cli/research",
)
"""No session beside an arm shows a message of these folders."""

ADVICE = {
    2: "Nothing was opened and nothing has moved. Correct the command, setting or file that the message names. `adaptsim config show` "
    "prints every setting with its origin.",
    3: "Nothing has moved, or the hand or the touch-off stopped by itself. `adaptsim doctor` with the same `--hw` lists what is missing, with "
    "the remedy of each.",
    4: "Nothing has moved. `adaptsim preview` with the same `--action` and `--context` shows which limit. Move the object, or the box that "
    "is in the way.",
    5: "The arm has stopped. Look at it and at what it touched, then run the same command: it shows the fault and asks for `recover`.",
    6: "The trial does not count; the recording is kept. Check camera, light and table, then run the same command.",
    7: "The operator stopped. Everything completed is stored; the same command continues.",
    8: "A file is damaged, missing or of another kind, or the disk is full. Nothing is repaired silently.",
    130: "Ctrl-C. Everything completed is stored; the same command continues.",
    1: "The simulation failed for another reason. Please report it with the output of `adaptsim --debug`.",
}
FEWEST_WORDS = 3
"""Shorter templates are only a value that is passed on."""


def messages(*, for_developers: bool = False) -> str:
    """Every documented error with its exit code, its meaning and its messages to an operator, or to a developer."""
    kinds = {kind.__name__: kind for kind in error_classes()}
    found: dict[str, set[str]] = {name: set() for name in kinds}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            if str(path.relative_to(ROOT)).startswith(DEVELOPERS) is not for_developers:
                continue
            for name, text in _raised(ast.parse(path.read_text(encoding="utf-8"))):
                if name in found and len(text.replace("…", "").split()) >= FEWEST_WORDS:
                    found[name].add(text)
    by_code: dict[int, list[str]] = {}
    for name, kind in kinds.items():
        if for_developers and not found[name]:
            continue
        by_code.setdefault(app.exit_code(kind("")), []).append(name)
    parts = [(DEVELOPERS_HEAD if for_developers else MESSAGES_HEAD).rstrip()]
    parts += [
        f"| [{code}](#exit-code-{code}) | {', '.join(sorted(names))} |" for code, names in sorted(by_code.items())
    ]
    for code, names in sorted(by_code.items()):
        parts.append(f"\n## Exit code {code}\n\n{ADVICE[code]}")
        for name in sorted(names):
            if not found[name]:
                continue
            parts.append(f"\n### {name}\n\n{_first(kinds[name])}\n")
            parts += [f"* {_escaped(text)}" for text in sorted(found[name], key=str.lower)]
    return "\n".join(parts) + "\n"


def error_classes() -> Iterator[type[BaseException]]:
    documented = app.documented_errors()
    for package in PACKAGES:
        for value in vars(importlib.import_module(f"{package}.errors")).values():
            if inspect.isclass(value) and issubclass(value, documented) and value.__module__ == f"{package}.errors":
                yield value


def _first(kind: type[BaseException]) -> str:
    return (inspect.getdoc(kind) or "").split("\n\n")[0].replace("\n", " ")


def _raised(tree: ast.AST) -> Iterator[Entry]:
    """(class, message) of every error that is made of a text in the source."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and node.args:
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            text = _template(node.args[0])
            if text:
                yield name, re.sub(r"(… ?)+…|…+", "…", " ".join(text.split())).strip()


def _template(node: ast.expr) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else "…" for v in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return (_template(node.left) or "…") + (_template(node.right) or "…")
    return ""


def _escaped(text: str) -> str:
    return re.sub(r"([*_<>\[\]|])", r"\\\1", text.replace("`", ""))
