"""A clock for tests: no waiting."""

from __future__ import annotations


class FakeClock:
    """Seconds since some origin; sleeping moves it and returns at once."""

    def __init__(self, t_s: float = 0.0) -> None:
        self._t_s = t_s

    def now_s(self) -> float:
        return self._t_s

    def sleep(self, duration_s: float) -> None:
        if duration_s < 0.0:
            raise ValueError(f"cannot sleep for {duration_s:g} s: the duration must be 0 or more")
        self._t_s += duration_s
