"""A person clears the arm's fault by typing a word; nothing moves."""

from __future__ import annotations

from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, enter, stop
from hw.errors import ArmFault
from hw.ports import Arm


def offer_recovery(arm: Arm, screen: Screen) -> None:
    """Help a person to clear the arm's fault, or let them leave it. Nothing moves.

    Waits until a person releases the stop button or stops guiding the arm. Clears any other fault if the person types
    so, and asks again until none is left. Raises StoppedByOperator.
    """
    while (state := arm.state()).fault is not None:
        screen.note(f"The arm reports: {state.fault}")
        if state.by_hand:
            then = "Reads the arm's state again. Nothing moves."
            screen.go_on("Resolve this first (nothing moves).", "when done", then=then, assurance="nothing has moved")
            continue
        clear = Key("recover", "to clear it", "Clears the arm's fault. Nothing moves.")
        leave = enter("to leave it", "Keeps the fault; the command ends before anything moves.")
        answer = screen.choose("Neither key moves anything.", clear, leave, stop("The command ends; the fault stays."))
        if answer == "q":
            raise StoppedByOperator("stopped by the operator; nothing has moved")
        if answer == "recover":
            try:
                arm.recover()
            except ArmFault as error:
                screen.note(f"  {error}")
        else:
            return
