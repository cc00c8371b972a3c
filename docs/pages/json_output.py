"""The reference of JSON output, from the models that every command prints through."""

from __future__ import annotations

import importlib
import re
import types
import typing
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from typing import Any

from pydantic import BaseModel

from adaptsim_cli.screen.outputs import unit_of
from adaptsim_cli.screen.outputs.catalogue import OUTPUTS
from pages import cell
from pages.file_fields import FILES

HEAD = """# JSON output

Written by `make docs` from the models that the program prints through; `adaptsim schema COMMAND` prints the same as a JSON schema.

Every command with `--json` prints one object on stdout, in one line, and everything else on stderr. (`run-iteration` prints one for each iteration.)
A failed command prints no JSON, unless its text below says otherwise: read its [exit code](commands.md#exit-codes) and stderr.

* Every output has a `version`. It counts up when a key goes, or means something else. New keys do not change it.
* Everything is numbered from 1: iterations, particles, trials, attempts.
* The end of a name is its unit (`_s`, `_mm`, `_bytes`). [Parameters, contexts and actions](parameters.md) are tables by name, and `units` gives the unit of each.
* A key that has nothing to say is `null`.

```sh
adaptsim run-iteration --task pendulum --world wd --yes --json
adaptsim schema run-iteration
```
"""


SHARED_BY = 3
"""From this number of models on, a key with one type and meaning is described in the table of shared keys."""

SHARED_HEAD = """## Shared keys

These keys mean the same wherever they stand.

| key | type | meaning |
|---|---|---|"""

Row = tuple[str, str, str]
"""key, type, meaning"""


def json_output() -> str:
    """One section per command; keys that several outputs, or an output and a file, share are described once."""
    models = list(dict.fromkeys(one for kind in OUTPUTS.values() for one in (kind, *_inside(kind))))
    counts = Counter(row for model in models if model not in STORED for row in _own_rows(model))
    common = {key: row for row, number in reversed(counts.most_common()) if number >= SHARED_BY for key in row[:1]}
    shared = [row for row in counts if row in common.values()]
    parts, described = [HEAD, SHARED_HEAD, *map(_line, shared), ""], dict[type[BaseModel], str]()
    for command, kind in OUTPUTS.items():
        parts.append(f"## adaptsim {command}\n\n{_sentence(kind)}\n")
        if kind in described:
            parts.append(f"As of [`adaptsim {described[kind]}`]({_anchor(described[kind])}).\n")
            continue
        for model in (kind, *_inside(kind)):
            if model in described:
                continue
            described[model] = command
            if model is not kind:
                parts.append(f"Each {model.__name__}: {_sentence(model)}\n")
            parts += [_model(model, shared, described), ""]
    return "\n".join(parts)


def _model(model: type[BaseModel], shared: Sequence[Row], described: Mapping[type[BaseModel], str]) -> str:
    """The keys of a model that nothing else describes, and where the others are described."""
    if model in STORED:
        file, part = STORED[model]
        return f"As `{part}` of [{file}](files.md#{re.sub(r'[^a-z-]', '', file)})."
    rows = _own_rows(model)
    bases = [base for base in model.__bases__ if base in described]
    blocks = [f"The keys of [{base.__name__}]({_anchor(described[base])}), and:" for base in bases]
    if own := [_line(row) for row in rows if row not in shared]:
        blocks.append("\n".join(["| key | type | meaning |", "|---|---|---|", *own]))
    if names := [f"`{row[0]}`" for row in rows if row in shared]:
        blocks.append(f"[Shared keys](#shared-keys): {', '.join(names)}.")
    return "\n\n".join(blocks)


def _anchor(command: str) -> str:
    return f"#adaptsim-{command.replace(' ', '-')}"


def _line(row: Row) -> str:
    key, kind, meaning = row
    return f"| `{key}` | {cell(kind)} | {cell(meaning)} |"


def _own_rows(model: type[BaseModel]) -> list[Row]:
    """The keys of a model without those of its bases."""
    inherited = {name for base in model.__bases__ if issubclass(base, BaseModel) for name in base.model_fields}
    rows = []
    for name, field in model.model_fields.items():
        if name in inherited:
            continue
        unit = unit_of(name)
        rows.append((name, _words(field.annotation), f"{field.description}{f' ({unit})' if unit else ''}"))
    return rows


def _stored() -> Iterator[tuple[type[BaseModel], tuple[str, str]]]:
    """The models that are also stored in files, with the file and the heading of the table that describes them there."""
    for file, _, tables in FILES:
        for heading, module, name in tables:
            if heading:
                yield getattr(importlib.import_module(module), name), (file, heading)


STORED = dict(_stored())


def _sentence(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split())


def _words(kind: Any) -> str:
    """A type as a reader of JSON calls it."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is type(None):
        return "null"
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(_words(one) for one in arguments))
    if origin in (list, tuple):
        inner = _words(arguments[0])
        is_fixed = origin is tuple and Ellipsis not in arguments
        return f"{len(arguments)} of {inner}" if is_fixed else f"list of {inner}"
    if origin is dict:
        return "object" if arguments[1] is Any else f"object of {_words(arguments[1])}"
    if isinstance(kind, type) and issubclass(kind, BaseModel | Enum):
        return kind.__name__ if issubclass(kind, BaseModel) else "one of " + ", ".join(one.value for one in kind)
    return {str: "text", int: "whole number", float: "number", bool: "true or false", Any: "any"}[kind]


def _inside(kind: Any) -> Iterator[type[BaseModel]]:
    """The models that a model is made of, those further in behind those further out."""
    for field in kind.model_fields.values():
        yield from _models(field.annotation)


def _models(kind: Any) -> Iterator[type[BaseModel]]:
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield kind
        yield from _inside(kind)
    for argument in typing.get_args(kind):
        if argument is not Any:
            yield from _models(argument)
