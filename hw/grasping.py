"""A grasp: the widths that count as the expected object between the fingers, and a hand that obeys at once."""

from __future__ import annotations

from typing import Self

from hw.errors import DeviceUnavailable, HandError
from hw.types import HandState

TOLERANCE_M = 0.005
SLIPPED_M = 0.001
"""If the fingers have moved by more than this since the grasp, they hold the tool differently."""


def narrower_m(width_m: float) -> float:
    """By how much (m) the object may be narrower than `width_m`. Fingers that closed on nothing never count."""
    return min(TOLERANCE_M, width_m / 2.0)


def fits(found_m: float, width_m: float) -> bool:
    """Whether fingers that stand `found_m` apart may hold an object `width_m` wide."""
    return width_m - narrower_m(width_m) <= found_m <= width_m + TOLERANCE_M


WIDEST_M = 0.08
STRONGEST_N = 70.0
"""Continuous force of the Franka Hand (the maker's data sheet)."""


class FakeHand:
    """Closes at once on an object `between_m` wide (None: nothing is between the fingers), and holds it.

    For tests of the code around a hand, and in the simulated lab. `commands` records its motions.
    """

    def __init__(self, between_m: float | None = None, *, holds: bool = False) -> None:
        """With `holds` it already grasps the object when the program connects."""
        self.between_m, self.holds, self.force_N = between_m, holds, 0.0
        self.width_m = between_m or 0.0 if holds else WIDEST_M
        self._homed = self._connected = False
        self.commands: list[str] = []

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._connected = False

    def state(self) -> HandState:
        """See `hw.ports.Hand`."""
        self._need_connection()
        return HandState(self.width_m, self.holds, self._homed)

    def home(self) -> None:
        """See `hw.ports.Hand`."""
        self._need_connection()
        if self.between_m is not None:
            raise HandError(
                "the hand could not be homed: something is between its fingers; take it out and home it again"
            )
        self.commands.append("home")
        self._homed, self.width_m, self.holds = True, WIDEST_M, False

    def move(self, width_m: float) -> None:
        """See `hw.ports.Hand`."""
        self._need_homing()
        if not 0.0 <= width_m <= WIDEST_M:
            raise HandError(
                f"the fingers cannot open to {1e3 * width_m:.1f} mm: the range is 0 to {1e3 * WIDEST_M:.0f} mm"
            )
        if self.between_m is not None and width_m < self.between_m:
            raise HandError(f"the fingers met something {1e3 * self.between_m:.1f} mm wide; grasp it instead")
        self.commands.append("move")
        self.width_m, self.holds, self.force_N = width_m, False, 0.0

    def grasp(self, width_m: float, force_N: float) -> None:
        """See `hw.ports.Hand`."""
        self._need_homing()
        if not 0.0 < force_N <= STRONGEST_N:
            raise HandError(f"a grasp force of {force_N:g} N: it must be above 0 and at most {STRONGEST_N:g} N")
        self.width_m = self.between_m or 0.0
        if not fits(self.width_m, width_m):
            raise HandError(
                f"the fingers closed to {1e3 * self.width_m:.1f} mm instead of {1e3 * width_m:.1f} mm: hold the tool's "
                "handle between them, or correct the width"
            )
        self.commands.append("grasp")
        self.holds, self.force_N = True, force_N

    def _need_homing(self) -> None:
        self._need_connection()
        if not self._homed:
            raise HandError("the hand has not been homed since it was switched on; empty it and home it first")

    def _need_connection(self) -> None:
        if not self._connected:
            raise DeviceUnavailable("the simulated hand is not connected: use it inside a `with` block")
