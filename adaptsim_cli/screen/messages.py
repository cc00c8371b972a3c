"""The messages of the program's own errors, read from its source, so that a person can ask what one means."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import cache
from pathlib import Path

PACKAGES = ("adaptsim_cli", "calib", "hw", "perception", "sim")
FEWEST_WORDS = 3
"""A shorter template is only a value that is passed on."""

LEAST_COMMON = 4
"""A message and its template have at least so many words in common, or all words of a shorter message."""

LEAST_LIKENESS = 0.55
"""Share of the words of a message and a template that agree in their order; below it they are different messages."""

ADVICE: Mapping[int, str] = {
    1: "The simulation failed for another reason. Please report it with the output of `adaptsim --debug`.",
    2: "Nothing was opened and nothing has moved. Correct the command, the setting or the file that the message names. "
    "`adaptsim config show` prints every setting with its origin.",
    3: "Nothing has moved, or the hand or the touch-off stopped by itself. `adaptsim doctor` with the same `--hw` "
    "names everything that is missing, each with its remedy.",
    4: "Nothing has moved. `adaptsim preview` with the same `--action` and `--context` shows which limit. Move the "
    "object, or the box that is in the way.",
    5: "The arm has stopped. Look at it and at everything that it touched, then run the same command. It shows the "
    "fault and asks for `recover`.",
    6: "The trial does not count; the recording is kept. Check camera, light and table, then run the same command.",
    7: "The operator stopped. Every completed trial is stored, and the same command continues.",
    8: "A file is damaged, missing or of another kind, or the disk is full. Nothing is repaired silently.",
    130: "Ctrl-C. Every completed trial is stored, and the same command continues.",
}
"""Exit code -> the state of the rig, and the next step."""


@dataclass(frozen=True)
class ErrorMessage:
    """A message that the program can raise; `…` stands for a value."""

    kind: str  # of the error; empty for a cause, which is a part of several messages
    template: str
    place: str  # package/file.py:line


def error_kinds(documented: tuple[type[BaseException], ...]) -> Mapping[str, type[BaseException]]:
    """Name -> class of every `documented` error that a package defines."""
    kinds = {}
    for package in PACKAGES:
        for value in vars(importlib.import_module(f"{package}.errors")).values():
            if inspect.isclass(value) and issubclass(value, documented) and value.__module__ == f"{package}.errors":
                kinds[value.__name__] = value
    return kinds


def meaning_of(kind: type[BaseException]) -> str:
    """The first paragraph of a class's docstring, on one line."""
    return " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split())


def all_messages(kinds: frozenset[str]) -> Sequence[ErrorMessage]:
    """All messages of errors of these kinds, and all causes that occur inside other messages."""
    return [one for one in _all_raised() if not one.kind or one.kind in kinds]


def nearest(text: str, messages: Sequence[ErrorMessage], count: int) -> Sequence[ErrorMessage]:
    """At most `count` templates that resemble a message, the most similar first; empty if no template resembles it."""
    words = _words(text)
    scores = [(_likeness(words, _words(one.template)), one) for one in messages]
    scores.sort(key=lambda entry: (-entry[0], entry[1].template != text))
    return [one for score, one in scores[:count] if score >= max(LEAST_LIKENESS, 0.9 * scores[0][0])]


def _likeness(words: Sequence[str], template: Sequence[str]) -> float:
    """The share of the shorter text's words that the other one has in the same order."""
    fewest = min(len(words), len(template))
    common = sum(block.size for block in SequenceMatcher(None, words, template, autojunk=False).get_matching_blocks())
    if common < min(LEAST_COMMON, len(words)):
        return 0.0
    return common / fewest - 0.001 * abs(len(words) - len(template))


def _words(text: str) -> Sequence[str]:
    return re.findall(r"[a-z]{2,}", text.lower())


@cache
def _all_raised() -> tuple[ErrorMessage, ...]:
    entries: list[ErrorMessage] = []
    for package in PACKAGES:
        origin = importlib.import_module(package).__file__
        assert origin is not None  # an ordinary package
        folder = Path(origin).parent
        for path in sorted(folder.rglob("*.py")):
            entries += _raised(path, f"{package}/{path.relative_to(folder)}")
    return tuple(entries)


def _raised(path: Path, name: str) -> Iterator[ErrorMessage]:
    """Every error in a source file that is made from a text, and the causes in its tables."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and node.args:
            kind = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            texts = [(kind, node.args[0])]
        elif isinstance(node, ast.Dict):
            texts = [("", value) for value in node.values]
        else:
            continue
        for kind, text in texts:
            template = re.sub(r"(… ?)+…|…+", "…", " ".join(_template(text).split())).strip()
            if len(template.replace("…", "").split()) >= FEWEST_WORDS:
                yield ErrorMessage(kind, template, f"{name}:{text.lineno}")


def _template(node: ast.expr) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else "…" for v in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return (_template(node.left) or "…") + (_template(node.right) or "…")
    return ""
