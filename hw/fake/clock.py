"""A clock that stands still until a test moves it."""

from __future__ import annotations


class FakeClock:
    """Seconds since some origin; sleeping moves it and returns at once."""

    def __init__(self, t_s: float = 0.0) -> None:
        self._t_s = t_s

    def now_s(self) -> float:
        """Seconds since the origin."""
        return self._t_s

    def sleep(self, duration_s: float) -> None:
        """Move on by `duration_s`. Raises ValueError when negative."""
        if duration_s < 0.0:
            raise ValueError(f"cannot sleep for {duration_s:g} s: the duration must be 0 or more")
        self._t_s += duration_s
