"""The keys that answer a question, and the line that a person types; Esc needs no Enter."""

from __future__ import annotations

import codecs
import os
import select
import sys
import termios
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass

ESCAPE = "\x1b"
HELP = "?"


@dataclass(frozen=True)
class Key:
    """One answer to a question."""

    typed: str  # lower case; "" is Enter
    does: str  # after the key: "to start", "when it lies there"
    meaning: str  # the effect, one sentence
    is_way_out: bool = False  # q and Esc mean it too

    @property
    def name(self) -> str:
        """Its name in a question."""
        return self.typed or "Enter"


def enter(does: str, meaning: str) -> Key:
    """The key that continues."""
    return Key("", does, meaning)


def stop(meaning: str) -> Key:
    """The key that ends the command; so does Esc."""
    return Key("q", "to stop", meaning, is_way_out=True)


def chosen(keys: Sequence[Key], answer: str) -> Key | None:
    """The typed key; None if it is not one of `keys`."""
    return next((key for key in keys if answer == key.typed or (key.is_way_out and answer in ("q", ESCAPE))), None)


def prompt(keys: Sequence[Key]) -> str:
    """The end of a question: `Enter to start, q to stop, ? explains`."""
    named = [f"{'type ' if len(key.typed) > 1 and key.typed.isalnum() else ''}{key.name} {key.does}" for key in keys]
    text = ", ".join([*named, f"{HELP} explains"])
    return text[:1].upper() + text[1:] if len(keys[0].typed) != 1 else text


def explained(keys: Sequence[Key]) -> list[tuple[str, str]]:
    """The explanations at `?`: (key, effect)."""
    return [(f"{key.name} or Esc" if key.is_way_out else key.name, key.meaning) for key in keys]


def unknown(answer: str) -> str:
    """The message for an unknown answer."""
    shown = "Esc" if answer == ESCAPE else answer if answer.isprintable() else repr(answer)
    return f"{shown} means nothing here, and nothing has happened."


LOOK_S = 0.02
_SEQUENCE_S = 0.05
"""Bytes that follow an Esc within this time belong to it: an arrow key sends several."""
_ENTER, _END, _DELETE, _DELETE_ALL = "\r\n", "\x04", "\x7f\x08", "\x15"


def read_line(otherwise: Callable[[], str | None] = lambda: None) -> str:
    """The typed line, with its Enter as "\\n"; `ESCAPE` at once if Esc was pressed; "" at the end of input.

    Input typed before the call does not answer the question and is discarded, because Enter may start a motion.
    `otherwise` is asked every `LOOK_S` for an answer that comes another way; it counts if nothing is typed yet.
    """
    if not sys.stdin.isatty():
        return sys.stdin.readline()
    fd = sys.stdin.fileno()
    with key_by_key(fd):
        while not select.select([fd], [], [], LOOK_S)[0]:
            if (answer := otherwise()) is not None:
                _echo(fd, f"{answer}\n")
                return f"{answer}\n"
        return _line(fd)


@contextmanager
def key_by_key(fd: int) -> Iterator[None]:
    """Put the terminal into a mode that delivers every key at once without echo; discard earlier input."""
    before = termios.tcgetattr(fd)
    single = termios.tcgetattr(fd)
    single[3] &= ~(termios.ICANON | termios.ECHO)  # signals stay on: Ctrl-C interrupts
    single[6][termios.VMIN], single[6][termios.VTIME] = 1, 0
    termios.tcsetattr(fd, termios.TCSAFLUSH, single)
    try:
        yield
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)


def _line(fd: int) -> str:
    typed, decode = "", codecs.getincrementaldecoder("utf-8")("replace").decode
    while True:
        data = os.read(fd, 1)
        if not data:
            return ""
        if data == ESCAPE.encode():
            if _alone(fd):
                _echo(fd, "\n")
                return ESCAPE
            continue
        for key in decode(data):
            if key in _ENTER:
                _echo(fd, "\n")
                return f"{typed}\n"
            if key == _END and not typed:
                return ""
            if key in _DELETE or key == _DELETE_ALL:
                gone = len(typed) if key == _DELETE_ALL else min(1, len(typed))
                typed = typed[: len(typed) - gone]
                _echo(fd, "\b \b" * gone)
            elif key.isprintable():
                typed += key
                _echo(fd, key)


def _alone(fd: int) -> bool:
    """Whether an Esc is the key itself; the rest of an arrow key or similar is discarded."""
    if not select.select([fd], [], [], _SEQUENCE_S)[0]:
        return True
    if os.read(fd, 1) in (b"[", b"O"):
        while select.select([fd], [], [], _SEQUENCE_S)[0] and not b"@" <= os.read(fd, 1) <= b"~":
            pass
    return False


def _echo(fd: int, text: str) -> None:
    with suppress(OSError):  # a read-only terminal
        os.write(fd, text.encode())
