"""Waivers: a lab goes without a safeguard for thirty days, for a reason that a named person typed.

No default is a waiver, and no message prints one. When it expires, the safeguard is required again.
"""

from __future__ import annotations

from datetime import date, timedelta
from typing import Annotated, Literal

from pydantic.dataclasses import dataclass

from adaptsim_cli.bench.rig_file.keys import RULES, key

DAYS = 30
"""A waiver counts for so long."""
SHORTEST_REASON = 10
Waivable = Literal["pedal", "hand", "person", "payload", "keep_out", "stop_button", "slow_start"]
"""The safeguards of a real lab that its rig file may waive."""
WITHOUT: dict[Waivable, str] = {
    "pedal": "the arm moves without anybody holding a pedal; only the stop button ends a motion",
    "hand": "nobody asks the hand whether it still holds the tool",
    "person": "no side is kept clear for a person: the arm may move wherever the operator stands",
    "payload": "the arm takes the weight of tool or object for a push, or a push for weight",
    "keep_out": "the arm knows no obstacle but table, camera and itself",
    "stop_button": "nobody shows every day that the stop button stops this arm",
    "slow_start": "a changed rig file, tool or calibration moves the arm at full speed at once",
}
"""The protection that is missing where a rig file waives a safeguard."""


@dataclass(frozen=True, config=RULES)
class WaiverPart:
    """A safeguard that this lab goes without for 30 days; `adaptsim setup` asks for the reason and writes it."""

    safeguard: Annotated[Waivable, key("pedal, hand (the tool is screwed on), person, payload, keep_out, stop_button, slow_start")]  # fmt: skip  # noqa: E501
    reason: Annotated[str, key("why, in a sentence of a person", min_length=SHORTEST_REASON)]
    by: Annotated[str, key("who decided it", min_length=1)]
    on: Annotated[str, key("the day, as 2026-11-26", min_length=10, max_length=10)]

    def __post_init__(self) -> None:
        if not self.reason.strip() or not self.by.strip():
            raise ValueError("a waiver needs a reason and the name of a person, not blanks")
        try:
            date.fromisoformat(self.on)
        except ValueError as error:
            raise ValueError(f"on = {self.on!r} is not a day: write it as 2026-11-26") from error

    @property
    def until(self) -> date:
        """The last day on which it counts."""
        return date.fromisoformat(self.on) + timedelta(days=DAYS)

    def counts(self, today: date) -> bool:
        """Whether it counts on that day. A later date does not count, except one day ahead, because of time zones."""
        return date.fromisoformat(self.on) - timedelta(days=1) <= today <= self.until

    @property
    def sentence(self) -> str:
        """The safeguard, the reason, the person, and the days from and to."""
        return f"{self.safeguard} is waived until {self.until}: {self.reason} ({self.by}, {self.on})"
