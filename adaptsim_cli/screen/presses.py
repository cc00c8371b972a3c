"""Answers by the enabling pedal: one short press, or two. Pure: looks at the pedal and times in, a count out.

A press counts only if it was seen from its beginning to its end, and the pedal was still for `PAUSE_S` after a single
one. So the pedal is up when a question is answered, and a motion needs a press of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

SHORT_S = 0.6
"""A longer press is a hold, which answers nothing."""
PAUSE_S = 0.4
"""A second press begins within this time of the end of the first."""


@dataclass(frozen=True)
class Presses:
    """What was seen since a question was asked."""

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
