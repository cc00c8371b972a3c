"""A hand that obeys at once, for tests of the code around a hand."""

from __future__ import annotations

from typing import Self

from hw.errors import DeviceUnavailable, HandError
from hw.grasping import fits
from hw.types import HandState

WIDEST_M, STRONGEST_N = 0.08, 70.0


class FakeHand:
    """Closes at once on an object `between_m` wide (None: nothing is between the fingers).

    `commands` records every call.
    """

    def __init__(self, between_m: float | None = None, *, holds: bool = False) -> None:
        """`holds`: it already grasps the object when the program connects."""
        self.between_m = between_m
        self.commands: list[str] = []
        self._width_m, self._holds, self._homed, self._connected = WIDEST_M, holds, False, False
        if holds:
            self._width_m = between_m or 0.0

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._connected = False

    def state(self) -> HandState:
        """See `hw.ports.Hand`."""
        self._need_connection()
        return HandState(self._width_m, self._holds, self._homed)

    def home(self) -> None:
        """See `hw.ports.Hand`."""
        self._need_connection()
        if self.between_m is not None:
            raise HandError(
                "the hand could not be homed: something is between its fingers; take it out and home it again"
            )
        self.commands.append("home")
        self._homed, self._width_m, self._holds = True, WIDEST_M, False

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
        self._width_m, self._holds = width_m, False

    def grasp(self, width_m: float, force_N: float) -> None:
        """See `hw.ports.Hand`."""
        self._need_homing()
        if not 0.0 < force_N <= STRONGEST_N:
            raise HandError(f"a grasp force of {force_N:g} N: it must be above 0 and at most {STRONGEST_N:g} N")
        found_m = self.between_m or 0.0
        if not fits(found_m, width_m):
            raise HandError(
                f"the fingers closed to {1e3 * found_m:.1f} mm instead of {1e3 * width_m:.1f} mm: hold the tool's "
                "handle between them, or correct the width"
            )
        self.commands.append("grasp")
        self._width_m, self._holds = found_m, True

    def _need_homing(self) -> None:
        self._need_connection()
        if not self._homed:
            raise HandError("the hand has not been homed since it was switched on; empty it and home it first")

    def _need_connection(self) -> None:
        if not self._connected:
            raise DeviceUnavailable("the fake hand is not connected: use it inside a `with` block")
