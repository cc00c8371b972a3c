"""Explains a file that breaks its schema: the place, and the probably intended key."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from pydantic import ValidationError


def place(loc: Sequence[int | str]) -> str:
    """The place of an error in a file; empty: the whole file."""
    return ".".join(str(part) for part in loc)


def unknown(key: str, name: str, keys: Sequence[str], title: str) -> str:
    """The message for an unknown `key` of a file: its last part `name` is not among the `keys` of `title`."""
    near = difflib.get_close_matches(name, keys, n=1)
    hint = f", did you mean {near[0]!r}?" if near else ";"
    return f"unknown key {key!r}{hint} {title}: {', '.join(keys)}"


def plain(message: str) -> str:
    """A message of pydantic, for the middle of a sentence."""
    text = message.replace("Input should be", "it must be")
    return text[0].lower() + text[1:]


def explained(error: ValidationError) -> str:
    """The first defect of a file, with its place."""
    first = error.errors()[0]
    return f"{place(first['loc']) or 'the whole file'}: {plain(first['msg'])}"
