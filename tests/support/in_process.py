"""A player without a process: the driver of an SDK's fake, played here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from hw.franka import connection, player
from hw.franka.driver import Reading
from hw.franka.messages import PlayOutcome
from hw.franka.playback import PlayableMotion
from hw.franka.settings import Payload
from hw.types import Guard
from hw.watchdog import WHY


@dataclass
class _Told:
    """What the program says, heard without a pipe."""

    word: Callable[[], bytes]

    def begin(self) -> None: ...

    def wanted(self) -> str:
        return WHY.get(self.word(), "")


@dataclass
class InProcess:
    """`hw.franka.process.Player` around a driver."""

    driver: connection.Connection
    alive: bool = True
    notes: tuple[str, ...] = ()

    def reading(self) -> Reading:
        return self.driver.reading()

    def recover(self) -> Reading:
        self.driver.recover()
        return self.driver.reading()

    def carry(self, payload: Payload) -> Reading:
        self.driver.carry(payload)
        return self.driver.reading()

    def play(self, motion: PlayableMotion, word: Callable[[], bytes], guard: Guard | None = None) -> PlayOutcome:
        return player.play(self.driver, motion, _Told(word), guard, start_s=600.0)  # type: ignore[arg-type]

    def close(self) -> None:
        self.alive = False
