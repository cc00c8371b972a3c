"""Decides by the widths before and after a stop whether it worked, and states the result in a sentence.

The Franka Hand may accept a stop and still move (libfranka's issues 18, 28, 52 and 111), or answer only once its
fingers have arrived. So only the width that the hand reports afterwards shows whether they stand still.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from hw.errors import FingersMoved, HandError
from hw.watchdog import IN_WORDS

STILL_S = 0.3
"""How long the width has to stay the same."""
STILL_M = 0.0005
"""A width that changes by less in that time stands still; the fingers' speed is 30 mm/s."""
COAST_M = 0.003
"""How far stopped fingers may move from the request to their rest: 0.1 s at their speed."""
WATCH_S = 3.0
"""The longest time to watch fingers that keep moving: the time that they need for their whole travel."""

Widths = Sequence[tuple[float, float]]
"""Rows of a time (s) and the fingers' width (m) then."""

_AGAIN = "run the command again: it homes the hand again"
_CARE = (
    "Keep clear of the fingers, and switch the arm off at its control box if they hold what they must not. No motion "
    "follows without a recovery: once the fingers stand, look at the hand and run the command again. It names this "
    "stop, asks before anything moves, and homes the hand again"
)


@dataclass(frozen=True)
class Stopped:
    """The answer to a command that was stopped, and the motion of the fingers after it."""

    why: str  # a key of `hw.watchdog.IN_WORDS`
    after_s: float  # from the request to stop until the hand accepted it
    from_m: float | None = None  # width when the stop was requested; None: it could not be read
    to_m: float | None = None  # the last width
    stands: bool = False  # whether the width had stopped changing
    stops: int = 1  # how many were sent

    @property
    def is_certain(self) -> bool:
        """Whether the fingers surely stood still at the place where they were stopped."""
        return self.stands and self._moved_m <= COAST_M

    @property
    def _moved_m(self) -> float:
        return 0.0 if self.from_m is None or self.to_m is None else abs(self.to_m - self.from_m)

    def error(self) -> HandError:
        """The error to raise, in words for a person; FingersMoved unless the fingers surely stand."""
        why = IN_WORDS[self.why]
        if self.is_certain:
            return HandError(f"the hand was stopped: {why}; look at it, then {_AGAIN}")
        if self.from_m is None or self.to_m is None:
            return FingersMoved(
                f"the hand accepted a stop ({why}), but its width could not be read, so nobody knows whether the "
                f"fingers stand. {_CARE}"
            )
        stop = "the stop was" if self.stops == 1 else f"{self.stops} stops were"
        widths = f"{1e3 * self.from_m:.1f} mm, then {1e3 * self.to_m:.1f} mm"
        if self.stands:
            return FingersMoved(
                f"{stop} accepted but the fingers still moved: {widths}, where they stand now ({why}). {_CARE}"
            )
        return FingersMoved(f"{stop} accepted but the fingers still move: {widths} ({why}). {_CARE}")


class Reader(Protocol):
    """Reads widths while somebody else moves the fingers."""

    def read(self, for_s: float) -> Widths:
        """All widths since the last call, and those of the next `for_s` seconds; empty if the hand does not answer."""


def stopped(
    why: str, stop: Callable[[], object], reader: Reader | None, clock: Callable[[], float], wait: Callable[[], None]
) -> Stopped:
    """Stop the fingers and watch them; stop them again while they move. Raises the errors of the first `stop`.

    `wait` gives the process that moved them the time to end.
    """
    began_s = clock()
    stop()
    after_s, stops, widths = clock() - began_s, 1, list[tuple[float, float]]()
    while reader is not None and (more := reader.read(STILL_S)):
        widths += more
        if _stands(widths) or clock() - began_s > WATCH_S:
            break
        try:
            stop()
        except Exception:  # noqa: BLE001 each SDK has its own errors; the first stop was accepted
            continue
        stops += 1
    wait()
    if not widths:
        return Stopped(why, after_s)
    before = [width_m for t_s, width_m in widths if t_s <= began_s]
    return Stopped(why, after_s, before[-1] if before else widths[0][1], widths[-1][1], _stands(widths), stops)


def _stands(widths: Widths) -> bool:
    last_s = widths[-1][0]
    late = [width_m for t_s, width_m in widths if t_s >= last_s - STILL_S]
    return last_s - widths[0][0] >= 0.5 * STILL_S and max(late) - min(late) < STILL_M
