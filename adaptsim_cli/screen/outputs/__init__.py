"""JSON output: a meaning for every field, and units."""

from __future__ import annotations

from typing import Any

from pydantic import Field, create_model
from pydantic.fields import FieldInfo

from hw.records import Record

VERSION = 1
"""Counts up when a key is removed or changes its meaning. New keys do not change it."""

UNITS = {
    "_s": "s", "_ms": "ms", "_m": "m", "_mm": "mm", "_mm_m": "mm/m", "_px": "px", "_deg": "degree", "_rad": "rad",
    "_mrad": "mrad", "_bytes": "byte", "_N": "N", "_C": "degree Celsius",
}  # fmt: skip
"""The end of a name is its unit."""

Quantities = dict[str, float]
"""Values by the names of their parameters, contexts or actions, in `units`."""


def described(meaning: str) -> Any:
    """A required field, with one line of meaning."""
    return Field(description=meaning)


def optional(meaning: str) -> Any:
    """A field that may be null, with one line of meaning."""
    return Field(None, description=meaning)


class Output(Record):
    """The output of one command."""

    version: int = Field(
        default=VERSION, description="of this output; it increases when a key is removed or changes its meaning"
    )


def printed(meaning: str, **keys: tuple[Any, str | FieldInfo]) -> type[Output]:
    """The output of a command: its meaning in one sentence, then each key with its type and its meaning.

    A key whose meaning is `optional` is null where the command does not give it.
    """
    fields = {key: (kind, described(text) if isinstance(text, str) else text) for key, (kind, text) in keys.items()}
    model: type[Output] = create_model("Printed", __base__=Output, __doc__=meaning, **fields)  # type: ignore[call-overload]
    return model


FOLDER = (str, "its folder")
"""A key of several outputs."""


def unit_of(name: str) -> str:
    """The unit at the end of a name, "" if it has none."""
    ends = [end for end in UNITS if name.endswith(end)]
    return UNITS[max(ends, key=len)] if ends else ""
