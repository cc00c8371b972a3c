"""Errors of the command line: settings, readiness, the operator, stored sessions.

CliError
├── UsageError           a wrong flag, setting or combination of them
├── PreflightFailed      something is not ready; nothing has moved
├── StoppedByOperator    the operator chose to stop; everything completed is kept
├── Interrupted          Ctrl-C; everything completed is kept
├── AnswerAwaited        a trial was asked for, and its answer comes later
├── AnswerRefused        the answer to a trial is missing or cannot count; it is kept, and may be corrected
└── SessionError         a stored session is corrupt, missing or cannot be written
    └── DiskFull         no room left for the next record

The functions below explain a file that breaks its schema: they name the place, and the key that was probably meant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import ValidationError


class CliError(Exception):
    """Base of everything that the command line itself raises."""


class UsageError(CliError):
    """A wrong flag, setting or combination of them."""


class PreflightFailed(CliError):
    """Something is not ready; nothing has moved."""


class StoppedByOperator(CliError):
    """The operator chose to stop."""


class Interrupted(CliError):
    """The operator pressed Ctrl-C."""


class AnswerAwaited(CliError):
    """A trial was asked for, and its answer comes later."""


class AnswerRefused(CliError):
    """The answer to a trial is missing or cannot count; it is kept, and may be corrected."""


class SessionError(CliError):
    """A stored session is corrupt, missing or cannot be written."""


class DiskFull(SessionError):
    """No room left for the next record."""


def location(loc: Sequence[int | str]) -> str:
    """The place of an error in a file; empty: the whole file."""
    return ".".join(str(part) for part in loc)


def unknown(key: str, name: str, keys: Sequence[str], title: str) -> str:
    """The message for an unknown `key` of a file: its last part `name` is not among the `keys` of `title`."""
    import difflib

    near = difflib.get_close_matches(name, keys, n=1)
    hint = f", did you mean {near[0]!r}?" if near else ";"
    return f"unknown key {key!r}{hint} {title}: {', '.join(keys)}"


def plain(message: str) -> str:
    """A message of pydantic, for the middle of a sentence."""
    text = message.replace("Input should be", "it must be")
    return text[0].lower() + text[1:]


def explained(error: ValidationError) -> str:
    """The first defect of a file, with its place."""
    from hw.records import number_hint  # pydantic is slow to import, and no other error needs it

    first = error.errors()[0]
    return f"{location(first['loc']) or 'the whole file'}: {plain(first['msg'])}{number_hint(first['input'])}"
