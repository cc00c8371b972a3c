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
    def alive(self) -> bool: ...
    def reading(self) -> Reading: ...
    def recover(self) -> Reading: ...
    def carry(self, payload: Payload) -> Reading: ...
    def play(self, motion: PlayableMotion, word: Callable[[], bytes], guard: Guard | None = None) -> PlayOutcome: ...
    def close(self) -> None: ...
