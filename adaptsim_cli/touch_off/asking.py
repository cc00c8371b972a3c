"""What a touch-off asks of whoever stands beside the robot; a person at a terminal, or nobody (`--yes`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.clear import clear_to_move
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.touch_off.parts import TouchRig

NEVER_CONFIRMS = "--yes never confirms the motion of a real arm; run the command in a terminal, without --yes"


class Assistant(Protocol):
    """Each may raise StoppedByOperator or UsageError."""

    def begin(self, rig: TouchRig) -> None:
        """Returns when this arm may be moved at all."""
        ...

    def empty_hand(self, rig: TouchRig) -> None:
        """Returns when nothing is in the hand."""
        ...

    def hand_over(self, rig: TouchRig) -> None:
        """Returns when the tool is held between the open fingers."""
        ...

    def clear(self, rig: TouchRig, what: str) -> None:
        """Returns when nobody is within reach any more, after somebody had their hands at the gripper.

        `what` the arm does next.
        """
        ...


@dataclass(frozen=True)
class HumanAssistant:
    """A person at the terminal answers."""

    screen: Screen

    def begin(self, rig: TouchRig) -> None:
        """See `Assistant`: the model of a real arm is typed once."""
        if rig.is_real:
            rig.confirm()

    def empty_hand(self, rig: TouchRig) -> None:
        """See `Assistant`."""
        self._go_on(
            f"Take the {rig.tool_name} out of the hand. Keep your own fingers away: the hand opens and closes.",
            "when it is empty",
            "The hand opens, closes, and is homed.",
        )

    def hand_over(self, rig: TouchRig) -> None:
        """See `Assistant`."""
        self._go_on(
            f"Hold the {rig.tool_name} between the fingers, as its drawing shows. Keep your own fingers clear: "
            f"the hand closes with {rig.grasp.force_N:g} N.",
            "to close",
            f"The hand closes on the {rig.tool_name}.",
        )

    def clear(self, rig: TouchRig, what: str) -> None:
        """See `Assistant`."""
        self._go_on(f"{clear_to_move(rig.is_real, what)}.", "to start", f"The arm {what}.")

    def _go_on(self, question: str, does: str, then: str) -> None:
        stopped = "stopped by the operator; nothing was stored"
        self.screen.go_on(question, does, then=then, stopped=stopped)


@dataclass(frozen=True)
class NoAssistant:
    """Nobody is there: the simulated lab alone."""

    def begin(self, rig: TouchRig) -> None:
        """See `Assistant`. Raises UsageError for a real arm."""
        if rig.is_real:
            raise UsageError(NEVER_CONFIRMS)

    def empty_hand(self, rig: TouchRig) -> None:
        """See `Assistant`; the simulated hand is empty."""
        return

    def hand_over(self, rig: TouchRig) -> None:
        """See `Assistant`; the simulated tool is there."""
        return

    def clear(self, rig: TouchRig, what: str) -> None:
        """See `Assistant`; nobody is in the way."""
        return
