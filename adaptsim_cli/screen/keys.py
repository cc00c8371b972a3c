"""The keys that answer a question, their names in the question, and their explanations at `?`. Pure."""

from __future__ import annotations

from collections.abc import Sequence
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
