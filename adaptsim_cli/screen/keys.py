"""The answers to a question: keys, the line that a person types, and short presses of the enabling pedal."""

from __future__ import annotations

import select
import sys
import termios
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

HELP = "?"


@dataclass(frozen=True)
class Key:
    """One answer to a question."""

    typed: str  # lower case; "" is Enter
    does: str  # after the key: "to start", "when it lies there"
    meaning: str  # the effect, one sentence
    is_way_out: bool = False  # q means it too

    @property
    def name(self) -> str:
        """Its name in a question."""
        return self.typed or "Enter"


def enter(does: str, meaning: str) -> Key:
    """The key that continues."""
    return Key("", does, meaning)


def stop(meaning: str) -> Key:
    """The key that ends the command."""
    return Key("q", "to stop", meaning, is_way_out=True)


def chosen(keys: Sequence[Key], answer: str) -> Key | None:
    """The typed key; None if it is not one of `keys`."""
    return next((key for key in keys if answer == key.typed or (key.is_way_out and answer == "q")), None)


def prompt(keys: Sequence[Key]) -> str:
    """The end of a question: `Enter to start, q to stop, ? explains`."""
    named = [f"{'type ' if len(key.typed) > 1 and key.typed.isalnum() else ''}{key.name} {key.does}" for key in keys]
    text = ", ".join([*named, f"{HELP} explains"])
    return text[:1].upper() + text[1:] if len(keys[0].typed) != 1 else text


def explained(keys: Sequence[Key]) -> list[tuple[str, str]]:
    """The explanations at `?`: (key, effect)."""
    return [(key.name, key.meaning) for key in keys]


def unknown(answer: str) -> str:
    """The message for an unknown answer."""
    return f"{answer if answer.isprintable() else repr(answer)} means nothing here, and nothing has happened."


LOOK_S = 0.02


def read_line(otherwise: Callable[[], str | None] | None = None) -> str:
    """The typed line with its end, "" at the end of input.

    Input typed before the call does not answer the question and is discarded, because Enter may start a motion.
    `otherwise` is asked every `LOOK_S` for an answer that comes another way.
    """
    if sys.stdin.isatty():
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
        while otherwise is not None and not select.select([sys.stdin], [], [], LOOK_S)[0]:
            if (answer := otherwise()) is not None:
                return f"{answer}\n"
    return sys.stdin.readline()


SHORT_S = 0.6
"""A longer press is a hold, which answers nothing."""
PAUSE_S = 0.4
"""A second press begins within this time of the end of the first."""


@dataclass(frozen=True)
class Presses:
    """The looks at the pedal since a question was asked: pure, looks and times in, a count out.

    A press counts only if it was seen from its beginning to its end, and the pedal was still for `PAUSE_S` after a
    single one. So the pedal is up when a question is answered, and a motion needs a press of its own.
    """

    down: bool | None = None  # at the last look; None: unknown, or not seen released yet
    since_s: float = 0.0
    short: int = 0  # short presses that have ended

    def after(self, down: bool | None, t_s: float) -> Presses:
        """After another look at `t_s`; `down` is None while nobody can tell."""
        if down is None or (self.down is None and down):
            return Presses()
        if down == self.down:
            return self
        if self.down is None or down:
            return replace(self, down=down, since_s=t_s)
        return Presses(False, t_s, self.short + 1 if t_s - self.since_s <= SHORT_S else 0)

    def count(self, t_s: float) -> int:
        """1 or 2 once so many presses are over, 0 before that."""
        if self.down is not False:
            return 0
        return 2 if self.short >= 2 else self.short if t_s - self.since_s > PAUSE_S else 0
