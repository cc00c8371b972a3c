"""Where the time of a command goes: every moment belongs to one stage, so that the stages add up to the wall time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

OTHER = "other"
"""The time of no stage that has a name."""


@dataclass
class Stopwatch:
    """Runs from the moment it is made."""

    now_s: Callable[[], float] = time.monotonic
    _spent_s: dict[str, float] = field(default_factory=dict)
    _stages: list[str] = field(default_factory=list)
    _since_s: float = -1.0

    def __post_init__(self) -> None:
        self._since_s = self.now_s()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """The time in it belongs to `name`; that of a stage within it belongs to that one alone."""
        self._charge()
        self._stages.append(name)
        try:
            yield
        finally:
            self._charge()
            self._stages.pop()

    def lap_s(self) -> dict[str, float]:
        """Seconds of each stage since the last lap; they add up to the time since then. A stage may be going on."""
        self._charge()
        spent, self._spent_s = self._spent_s, {}
        return spent

    def _charge(self) -> None:
        """Everything until now belongs to the stage that is going on."""
        name, now_s = self._stages[-1] if self._stages else OTHER, self.now_s()
        self._spent_s[name] = self._spent_s.get(name, 0.0) + now_s - self._since_s
        self._since_s = now_s


def added(*laps: dict[str, float]) -> dict[str, float]:
    """The laps together, stage by stage, `other` last."""
    names = dict.fromkeys(name for lap in laps for name in lap)
    ordered = [name for name in names if name != OTHER] + [name for name in names if name == OTHER]
    return {name: sum(lap.get(name, 0.0) for lap in laps) for name in ordered}
