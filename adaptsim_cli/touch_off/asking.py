"""What a touch-off asks of whoever stands beside the robot; a person at a terminal, or nobody (`--yes`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from adaptsim_cli.console import Screen
from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.session.clear import clear_to_move
from adaptsim_cli.touch_off.parts import TouchRig

NEVER_CONFIRMS = "--yes never confirms the motion of a real arm; run without it, at a terminal"


class Operator(Protocol):
    """Each may raise StoppedByOperator or UsageError."""

    def begin(self, rig: TouchRig) -> None:
        """Returns when the workspace is clear and the arm may move."""
        ...

    def empty_hand(self, rig: TouchRig) -> None:
        """Returns when nothing is in the hand."""
        ...

    def hand_over(self, rig: TouchRig) -> None:
        """Returns when the tool is held between the open fingers."""
        ...


@dataclass(frozen=True)
class Attended:
    """A person at the terminal answers."""

    screen: Screen

    def begin(self, rig: TouchRig) -> None:
        if rig.is_real:
            rig.confirm()
        else:
            self._go_on(clear_to_move(False, "touches the table, slowly") + ". Enter to start, q to stop:")

    def empty_hand(self, rig: TouchRig) -> None:
        self._go_on(f"Take the {rig.tool_name} out of the hand; the fingers will open and close. Enter when empty:")

    def hand_over(self, rig: TouchRig) -> None:
        self._go_on(
            f"Hold the {rig.tool_name} between the fingers, as its drawing shows, your own fingers away from theirs: "
            f"they close with {rig.grasp.force_N:g} N. Enter to close, q to stop:"
        )

    def _go_on(self, question: str) -> None:
        while (answer := self.screen.ask(question)) != "":
            if answer == "q":
                raise StoppedByOperator("stopped by the operator; nothing was stored")


@dataclass(frozen=True)
class Unattended:
    """Nobody is there: the simulated lab alone."""

    def begin(self, rig: TouchRig) -> None:
        if rig.is_real:
            raise UsageError(NEVER_CONFIRMS)

    def empty_hand(self, rig: TouchRig) -> None:
        return

    def hand_over(self, rig: TouchRig) -> None:
        return
