"""Divides the time of a command into stages.

Every moment belongs to one stage, so the stages add up to the wall time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

OTHER = "other"
"""The stage of all other time."""


@dataclass
class Stopwatch:
    """A stopwatch that runs from its construction."""

    now_s: Callable[[], float] = time.monotonic
    _spent_s: dict[str, float] = field(default_factory=dict)
    _stages: list[str] = field(default_factory=list)
    _since_s: float = -1.0

    def __post_init__(self) -> None:
        self._since_s = self.now_s()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time inside as `name`, except for the time of nested stages."""
        self._charge()
        self._stages.append(name)
        try:
            yield
        finally:
            self._charge()
            self._stages.pop()

    def lap_s(self) -> dict[str, float]:
        """Seconds of each stage since the last lap; they add up to the time since then.

        A stage may still be running.
        """
        self._charge()
        spent, self._spent_s = self._spent_s, {}
        return spent

    def _charge(self) -> None:
        """Charge the time until now to the running stage."""
        name, now_s = self._stages[-1] if self._stages else OTHER, self.now_s()
        self._spent_s[name] = self._spent_s.get(name, 0.0) + now_s - self._since_s
        self._since_s = now_s


def added(*laps: dict[str, float]) -> dict[str, float]:
    """The sum of laps by stage, `other` last."""
    names = dict.fromkeys(name for lap in laps for name in lap)
    ordered = [name for name in names if name != OTHER] + [name for name in names if name == OTHER]
    return {name: sum(lap.get(name, 0.0) for lap in laps) for name in ordered}
