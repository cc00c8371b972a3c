"""The lab's hand, as `hw.ports.Hand`, and the simulated person who offers it the tool."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from hw.errors import DeviceUnavailable, HandError
from hw.grasping import fits
from hw.types import HandState

WIDEST_M = 0.08
STRONGEST_N = 70.0
"""Continuous force of the Franka Hand (the maker's data sheet)."""


@dataclass(eq=False)
class Grip:
    """The object between the fingers, and the grasping force; shared with the arm that carries it."""

    handle_m: float  # thickness of the tool's handle
    offered: bool = False  # somebody holds the tool between the fingers
    holds: bool = False
    force_N: float = 0.0


class LabHand:
    """Opens, closes, and holds the object between its fingers."""

    def __init__(self, grip: Grip) -> None:
        self._grip = grip
        self._width_m, self._homed, self._connected = WIDEST_M, False, False

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._connected = False

    def state(self) -> HandState:
        """See `hw.ports.Hand`."""
        self._need_connection()
        return HandState(self._width_m, self._grip.holds, self._homed)

    def home(self) -> None:
        """See `hw.ports.Hand`."""
        self._need_connection()
        if self._grip.offered or self._grip.holds:
            raise HandError(
                "the hand could not be homed: something is between its fingers; take it out and home it again"
            )
        self._homed, self._width_m = True, WIDEST_M

    def move(self, width_m: float) -> None:
        """See `hw.ports.Hand`."""
        self._need_homing()
        if not 0.0 <= width_m <= WIDEST_M:
            raise HandError(
                f"the fingers cannot open to {1e3 * width_m:.1f} mm: the range is 0 to {1e3 * WIDEST_M:.0f} mm"
            )
        if self._grip.offered and width_m < self._grip.handle_m:
            raise HandError(f"the fingers met something {1e3 * self._grip.handle_m:.1f} mm wide; grasp it instead")
        self._width_m, self._grip.holds, self._grip.force_N = width_m, False, 0.0

    def grasp(self, width_m: float, force_N: float) -> None:
        """See `hw.ports.Hand`."""
        self._need_homing()
        if not 0.0 < force_N <= STRONGEST_N:
            raise HandError(f"a grasp force of {force_N:g} N: it must be above 0 and at most {STRONGEST_N:g} N")
        found_m = self._grip.handle_m if self._grip.offered else 0.0
        if not fits(found_m, width_m):
            self._width_m = found_m
            raise HandError(
                f"the fingers closed to {1e3 * found_m:.1f} mm, {1e3 * width_m:.1f} mm were expected: hold the tool's "
                "handle between them, or correct the width"
            )
        self._width_m, self._grip.holds, self._grip.force_N = found_m, True, force_N

    def _need_homing(self) -> None:
        self._need_connection()
        if not self._homed:
            raise HandError("the hand has not been homed since it was switched on; empty it and home it first")

    def _need_connection(self) -> None:
        if not self._connected:
            raise DeviceUnavailable("the lab's hand is not connected: use it inside a `with` block")
