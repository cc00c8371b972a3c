"""The reference of files, from the models that read and write them."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator

from pages import cell
from pages.file_fields import FILES, SAID

FILES_HEAD = """# Files, field by field

Written by `make docs` from the models that read and write these files. In files that a person writes, an unknown key
is an error; in files that the program writes, it is an addition of a newer version, and is kept. Each file is written whole or
not at all. A field without a default must be given. [A session on disk](sessions.md) tells where each file of
a session lies and when it is written; [calibrate](../guide/calibrate.md#views-from-elsewhere) has examples of views.

Conventions: the end of a name is its unit (`_m`, `_rad`, `_s`, `_N`). `X_AB` is the pose of B in A, four rows of four. B is the arm's base, F the flange and T the tool; C is the colour camera, D the depth
camera, M the board and H its holder. Times are ISO 8601.
"""


def files() -> str:
    """One section per file, one table per part."""
    parts = [FILES_HEAD]
    for title, text, tables in FILES:
        parts.append(f"## {title}\n\n{text}\n")
        for heading, module, name in tables:
            if heading:
                parts.append(f"`{heading}`\n" if heading[0] == "[" and heading[-1] == "]" else f"{heading}:\n")
            parts += ["| field | type | default | meaning |", "|---|---|---|---|"]
            parts += [f"| `{f}` | {cell(t)} | {d} | {cell(m)} |" for f, t, d, m in fields(module, name)]
            parts.append("")
    return "\n".join([*parts, TRIALS_HEAD, *columns(), ""])


TRIALS_HEAD = """## A table of trials

`adaptsim sessions export NAME --format csv` or `parquet`, and `trials.csv` beside a comparison: a row a trial that counts. Columns `parameter_NAME`, `context_NAME`
and `action_NAME` hold each quantity of the task, in its unit. The meanings are those of session.toml and trial.json.

| column | meaning |
|---|---|"""

RECORDS = "adaptsim_cli.session.records"
COLUMNS = {
    "session": ("SessionFacts", "name"),
    **{name: ("SessionFacts", name) for name in ("task", "hw", "world", "method", "seed")},
    **{name: ("MotionRecord", name) for name in ("started", "iteration", "trial", "attempt", "particle", "role")},
    **{name: ("TrialRecord", name) for name in ("outcome", "overruled_from", "reward")},
    "predicted_reward": ("MotionRecord", "predicted_reward"),
}
"""Each column of a table of trials, and the field that holds its meaning."""


def columns() -> Iterator[str]:
    """A row for each column."""
    meanings = {kind: {name: text for name, _, _, text in fields(RECORDS, kind)} for kind, _ in COLUMNS.values()}
    yield from (f"| `{column}` | {cell(meanings[kind][name])} |" for column, (kind, name) in COLUMNS.items())
    yield "| `duration_s` | time from the start of the motion to the last observed moment |"


def fields(module: str, name: str) -> Iterator[tuple[str, str, str, str]]:
    """(field, type, default, meaning) of a model or dataclass, its meaning from comment, docstring or description."""
    owner = getattr(importlib.import_module(module), name)
    source = textwrap.dedent(inspect.getsource(owner))
    lines = source.splitlines()
    body = ast.parse(source).body[0].body  # type: ignore[attr-defined]
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        field = node.target.id
        meaning, unit = _described(node)
        if not meaning and (described := getattr(owner, "__pydantic_fields__", {}).get(field)):
            meaning = described.description or ""
        if not meaning and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            meaning = str(after.value.value)
        if not meaning and "  # " in (last := lines[(node.end_lineno or 1) - 1]):
            meaning = last.split("  # ", 1)[1].removeprefix("noqa").strip()
        if meaning in ("", "fmt: skip", "ISO 8601"):
            meaning = SAID.get(field, "")
        if not meaning:
            raise SystemExit(f"{module}.{name}.{field} says nowhere what it means: add a comment beside it")
        yield field, _type(node.annotation), _default(node.value), meaning + (f" ({unit})" if unit else "")


def _described(node: ast.AnnAssign) -> tuple[str, str]:
    """Description and unit of a pydantic field, read from the source or from its dataclass in `Annotated`."""
    text = unit = ""
    for call in ast.walk(node):
        if not isinstance(call, ast.Call):
            continue
        for keyword in call.keywords:
            if keyword.arg == "description" and isinstance(keyword.value, ast.Constant):
                text = str(keyword.value.value)
            if keyword.arg == "json_schema_extra" and isinstance(keyword.value, ast.Dict):
                unit = str(ast.literal_eval(keyword.value)["unit"])
        if isinstance(call.func, ast.Name) and call.func.id in ("described", "optional"):
            text = str(ast.literal_eval(call.args[0]))
        if isinstance(call.func, ast.Name) and call.func.id == "key":
            text, unit = [*(_computed(arg) for arg in call.args), ""][:2]
    return text, unit


def _computed(node: ast.expr) -> str:
    """A text as it is written in the source; "" if the source computes it, because then the class itself has it."""
    return str(ast.literal_eval(node)) if isinstance(node, ast.Constant) else ""


def _type(node: ast.expr) -> str:
    if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Annotated" and isinstance(node.slice, ast.Tuple):
        node = node.slice.elts[0]
    text = ast.unparse(node)
    for old, new in (
        ("Quantities", "dict[str, float]"),
        ("tuple[tuple[float, ...], ...]", "list of vectors"),
        ("tuple[float, ...]", "vector"),
        ("tuple[Samples, ...]", "list of lists of vectors"),
        ("tuple[Row, ...]", "list of vectors"),
        ("dict[str, Any]", "table"),
        ("Numbers", "list of float"),
        ("Row", "vector"),
        ("Matrix", "rows"),
        ("str | None", "str"),
        (" | None", ""),
    ):
        text = text.replace(old, new)
    text = re.sub(r"\bHardware\b", "Literal['fake', 'panda', 'fr3', 'fr3v2']", text)
    text = re.sub(r"\bSide\b", "Literal['left', 'right', 'front', 'back']", text)
    text = re.sub(r"\b\w+(Part|Record|Collision|Summary)\b|\b(Collision|MeasuredValue)\b", "table", text)
    text = re.sub(r"tuple\[tuple\[int, float\], \.\.\.\]", "list of int and float", text)
    text = re.sub(r"tuple\[(\w+), \.\.\.\]", r"list of \1", text)
    text = re.sub(r"tuple\[(Three|Four)(, \1)+\]", lambda m: f"{m[1].lower()} rows of {m[1].lower()}", text)
    text = re.sub(r"tuple\[(float|int)(?:, \1)+\]", lambda m: f"{m[0].count(m[1])} {m[1]}", text)
    text = re.sub(r"tuple\[(\d \w+), \.\.\.\]", r"list of \1", text)
    for word, number in (("Range", 2), ("Interval", 2), ("Three", 3), ("Six", 6), ("Seven", 7)):
        text = re.sub(rf"\b{word}\b", f"{number} float", text)
    text = re.sub(r"Literal\[(.*)\]", lambda m: " or ".join(m[1].split(", ")), text)
    return re.sub(r"dict\[str, (.*)\]", r"table of \1", text).replace("'", "`")


def _default(node: ast.expr | None) -> str:
    """The default as it stands in the source; a dash where the field must be given."""
    if node is None or ast.unparse(node).startswith("described("):
        return "–"
    if ast.unparse(node).startswith(("_", "tuple(")):
        return "the maker's"
    if isinstance(node, ast.Call):
        if any(k.arg == "default_factory" for k in node.keywords):
            return "all defaults"
        return f"`{ast.unparse(node.args[0])}`" if node.args else "–"
    text = ast.unparse(node)
    if text in ("()", "{}", "''", "None"):
        return "left out"
    return "`1`" if text == "FORMAT" else f"`{text}`"
