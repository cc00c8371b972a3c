"""Explains a file that breaks its schema: the place, and the key that was probably meant."""

from __future__ import annotations

import difflib
from collections.abc import Sequence


def place(loc: Sequence[int | str]) -> str:
    """Where in a file something is wrong; empty: the file as a whole."""
    return ".".join(str(part) for part in loc)


def unknown(key: str, name: str, known: Sequence[str], title: str) -> str:
    """The message for a `key` of a file whose last part, `name`, is none of the `known` ones under `title`."""
    near = difflib.get_close_matches(name, known, n=1)
    hint = f", did you mean {near[0]!r}?" if near else ";"
    return f"unknown key {key!r}{hint} {title}: {', '.join(known)}"


def plain(message: str) -> str:
    """A message of pydantic in the middle of a sentence."""
    return message[0].lower() + message[1:]
