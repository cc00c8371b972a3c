"""Checks before every motion of a trial that the hand still holds the tool."""

from __future__ import annotations

from dataclasses import dataclass, field

from adaptsim_cli.screen.views import Readiness
from hw.errors import DeviceUnavailable, HandError
from hw.ports import Hand

SLIPPED_M = 0.001
"""A larger change (m) of the fingers' width means that the tool has slipped, or is another one."""


@dataclass
class ToolWatch:
    """The fingers' width at the first check counts as that of the held tool. Nothing moves."""

    hand: Hand
    tool: str  # its name
    remedy: str  # the command for grasping it again
    width_m: float | None = field(default=None, init=False)  # at the first check

    def check(self) -> Readiness:
        """A line of the checklist before a session; names a hand that does not answer."""
        try:
            self.require()
        except (HandError, DeviceUnavailable) as error:
            return Readiness("tool", False, str(error))
        assert self.width_m is not None
        return Readiness("tool", True, f"held, the fingers are {1e3 * self.width_m:.1f} mm apart")

    def require(self) -> None:
        """Raises HandError if the tool is lost or has slipped, DeviceUnavailable if the hand does not answer."""
        now = self.hand.state()
        stands = f"the fingers are {1e3 * now.width_m:.1f} mm apart"
        if not now.holds:
            raise HandError(
                f"the hand does not hold the {self.tool} ({stands}). Find the tool and clear it away, then have the "
                f"hand grasp it again: {self.remedy}"
            )
        if self.width_m is None:
            self.width_m = now.width_m
        if abs(now.width_m - self.width_m) > SLIPPED_M:
            raise HandError(
                f"the {self.tool} has slipped: {stands}, {1e3 * self.width_m:.1f} mm at first (at most "
                f"{1e3 * SLIPPED_M:g} mm may change). Its pose is no longer known; have the hand grasp it again: "
                f"{self.remedy}"
            )
