"""What a Franka arm asks of the pedal and of the process that plays its motions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from hw.franka.driver import Reading
from hw.franka.messages import PlayOutcome
from hw.franka.playback import PlayableMotion
from hw.franka.settings import Payload
from hw.types import Guard


class Player(Protocol):
    """What is asked of the process that plays motions (`hw.franka.process.PlayerProcess`). All raise Failure."""

    @property
    def alive(self) -> bool:
        """Whether its process runs."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What the computer does not give its process: a sentence each."""
        ...

    def reading(self) -> Reading:
        """What the arm reports now."""
        ...

    def recover(self) -> Reading:
        """Clear a fault; what the arm reports then."""
        ...

    def carry(self, payload: Payload) -> Reading:
        """Set what the hand holds; what the arm reports then."""
        ...

    def play(self, motion: PlayableMotion, word: Callable[[], bytes], guard: Guard | None = None) -> PlayOutcome:
        """Play `motion`; `word` is asked every few milliseconds whether it may go on, `guard` ends it at a contact."""
        ...

    def close(self) -> None:
        """End the process; the arm stops if it moves."""
        ...
