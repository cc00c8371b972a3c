"""The answers to a question: its keys, and the line that a person types."""

from __future__ import annotations

import select
import sys
import termios
from collections.abc import Sequence
from dataclasses import dataclass

HELP = "?"


@dataclass(frozen=True)
class Key:
    """One answer to a question."""

    typed: str  # lower case; "" is Enter
    does: str  # after the key: "to start", "when it lies there"
    meaning: str  # the effect, one sentence
    is_way_out: bool = False  # q means it too
    aliases: tuple[str, ...] = ()  # words that mean it too

    @property
    def name(self) -> str:
        """Its name in a question."""
        return self.typed or "Enter"


def enter(does: str, meaning: str) -> Key:
    """The key that continues."""
    return Key("", does, meaning)


def agree(does: str, meaning: str) -> Key:
    """The key that agrees, y or yes. It is never used for a motion, because only one typed key starts a motion."""
    return Key("y", does, meaning, aliases=("yes",))


def stop(meaning: str) -> Key:
    """The key that ends the command."""
    return Key("q", "to stop", meaning, is_way_out=True)


def chosen(keys: Sequence[Key], answer: str) -> Key | None:
    """The typed key; None if it is not one of `keys`."""
    return next((key for key in keys if answer in (key.typed, *key.aliases, *("q",) * key.is_way_out)), None)


def prompt(keys: Sequence[Key]) -> str:
    """The end of a question: `Type y to start, q to stop, ? explains`."""
    first = keys[0]
    named = [f"{'type ' if _is_typed(key, key is first) else ''}{key.name} {key.does}" for key in keys]
    text = ", ".join([*named, f"{HELP} explains"])
    return text[:1].upper() + text[1:]


def _is_typed(key: Key, is_first: bool) -> bool:
    return key.typed.isalnum() and (is_first or len(key.typed) > 1)


def explained(keys: Sequence[Key]) -> list[tuple[str, str]]:
    """The explanations at `?`: (key, effect)."""
    return [(key.name, key.meaning) for key in keys]


def unknown(answer: str, keys: Sequence[Key] = ()) -> str:
    """The message for an unknown answer, with the keys that are known."""
    shown = answer if answer.isprintable() else repr(answer)
    names = f" The keys: {', '.join([*(key.name for key in keys), HELP])}." if keys else ""
    return f"{shown or 'Enter alone'} means nothing here, and nothing has happened.{names}"


def read_line() -> str:
    """The typed line with its end, "" at the end of input.

    Input typed before the call does not answer the question and is discarded, because an answer may start a motion.
    """
    if sys.stdin.isatty():
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
    return sys.stdin.readline()


def lines_typed() -> list[str]:
    """The lines typed since the last answer, lower case and stripped, without waiting; none without a terminal.

    Never for an answer that can start a motion.
    """
    lines = []
    while sys.stdin.isatty() and select.select([sys.stdin], [], [], 0.0)[0] and (line := sys.stdin.readline()):
        lines.append(line.strip(" \t\r\n").lower())
    return lines
