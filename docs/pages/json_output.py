"""The reference of JSON output, from the models that every command prints through."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator
from enum import Enum
from typing import Any

from pydantic import BaseModel

from adaptsim_cli.screen.outputs import Output, unit_of
from adaptsim_cli.screen.outputs.catalogue import OUTPUTS
from pages import cell

HEAD = """# JSON output

Written by `make docs` from the models that the program prints through; `adaptsim schema COMMAND` prints the same as a JSON schema.

Every command with `--json` prints one object on stdout, in one line, and everything else on stderr. (`run-iteration` prints one for each iteration.)
A failed command prints no JSON, unless its text below says otherwise: read its [exit code](commands.md#exit-codes) and stderr.

* `version` counts up when a key goes, or means something else. New keys do not change it.
* Everything is numbered from 1: iterations, particles, trials, attempts.
* The end of a name is its unit (`_s`, `_mm`, `_bytes`). [Parameters, contexts and actions](parameters.md) are tables by name, and `units` gives the unit of each.
* A key that has nothing to say is `null`.

```sh
adaptsim run-iteration --task pendulum --world wd --yes --json
adaptsim schema run-iteration
```
"""


def json_output() -> str:
    """One section a command; a part that several outputs share is described once."""
    parts, told = [HEAD], set[type[BaseModel]]()
    for command, kind in OUTPUTS.items():
        parts.append(f"## adaptsim {command}\n\n{_sentence(kind)}\n")
        if kind in told:
            same = next(other for other, one in OUTPUTS.items() if one is kind)
            parts.append(f"As of [`adaptsim {same}`](#adaptsim-{same.replace(' ', '-')}).\n")
            continue
        for model in (kind, *_inside(kind)):
            if model in told:
                continue
            told.add(model)
            if model is not kind:
                parts.append(f"Each {model.__name__}: {_sentence(model)}\n")
            parts += ["| key | type | meaning |", "|---|---|---|", *_rows(model), ""]
    return "\n".join(parts)


def _rows(model: type[BaseModel]) -> Iterator[str]:
    for name, field in model.model_fields.items():
        if name == "version" and model is not Output:
            continue
        unit = unit_of(name)
        meaning = f"{field.description}{f' ({unit})' if unit else ''}"
        yield f"| `{name}` | {cell(_words(field.annotation))} | {cell(meaning)} |"


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
