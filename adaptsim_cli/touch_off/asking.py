"""The questions of a touch-off to the operator: a person at a terminal, or nobody (`--yes`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.views import clear_to_move
from adaptsim_cli.touch_off.parts import TouchRig

NEVER_CONFIRMS = "--yes never confirms the motion of a real arm; run the command in a terminal, without --yes"


class Assistant(Protocol):
    """The questions of a touch-off. Each may raise StoppedByOperator or UsageError."""

    def begin(self, rig: TouchRig) -> None:
        """Returns once this arm may be moved at all."""
        ...

    def empty_hand(self, rig: TouchRig) -> None:
        """Returns once the hand is empty."""
        ...

    def hand_over(self, rig: TouchRig) -> None:
        """Returns once the person holds the tool between the open fingers."""
        ...

    def clear(self, rig: TouchRig, what: str) -> None:
        """Returns once nobody is within reach any more, after somebody had their hands at the gripper.

        `what` is the arm's next motion.
        """
        ...


@dataclass(frozen=True)
class HumanAssistant:
    """A person at the terminal."""

    screen: Screen

    def begin(self, rig: TouchRig) -> None:
        """See `Assistant`: the person types the model of a real arm once."""
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
        self.screen.go_on(question, does, then=then, kept="nothing was stored")


@dataclass(frozen=True)
class NoAssistant:
    """Nobody; only for the simulated lab."""

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
