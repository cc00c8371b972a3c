"""An arm that a person guides by hand: waiting until it rests, and connecting again after guiding ended the connection.

To guide an FR3, a person may have to leave Execution in Desk, which ends the research interface (FCI). Everything that
the person has shown until then is kept.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import enter, stop
from hw.errors import ArmFault, DeviceUnavailable
from hw.ports import Arm, ArmWrapper
from hw.types import ArmState, Execution, JointPath

REST_RAD_S = 0.003
"""A joint that is slower than this counts as at rest: the board then moves less than 0.1 mm within 30 ms."""
DRIFT_RAD = 2e-4
"""Largest change of a joint (rad) between two readings at rest."""
WAIT_S, POLL_S = 5.0, 0.05


class NotAtRest(Exception):
    """The arm does not come to rest, or a person still guides it. The message gives the reason."""


class GuidedArm(ArmWrapper[Arm]):
    """`hw.ports.Arm` while a person guides it: a lost connection is a question, not the end of the command."""

    def __init__(self, arm: Arm, screen: Screen, assurance: str) -> None:
        """`assurance` tells the person that nothing is lost."""
        super().__init__(arm)
        self._screen, self._kept = screen, assurance

    def state(self) -> ArmState:
        """The state, once the arm answers. Raises StoppedByOperator."""
        while True:
            try:
                return self._arm.state()
            except DeviceUnavailable as error:
                self._ask(str(error))

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`."""
        return self._arm.execute(path)

    def _ask(self, why: str) -> None:
        self._screen.note(f"  The connection is lost: {why}. Guiding may have ended it. {self._kept}")
        again = enter("to connect again", "The program connects to the arm. Nothing moves.")
        way_out = stop(f"The command ends. {self._kept}")
        question = f"In Desk switch the {self.model} to Execution, unlock the joints and activate FCI. Done?"
        if self._screen.choose(question, again, way_out) == "q":
            raise StoppedByOperator(f"stopped by the operator. {self._kept}")


def at_rest(arm: Arm, pause: Callable[[float], None]) -> ArmState:
    """Wait for two readings in a row at rest, with nobody guiding the arm.

    Raises NotAtRest after `WAIT_S`, ArmFault.
    """
    last, still = state_of(arm), False
    for _ in range(round(WAIT_S / POLL_S)):
        pause(POLL_S)
        now = state_of(arm)
        rests = now.fault is None and bool(np.abs(now.dq_rad_s).max() <= REST_RAD_S)
        if still and rests and np.abs(now.q_rad - last.q_rad).max() <= DRIFT_RAD:
            return now
        still, last = rests, now
    if last.fault is not None:
        raise NotAtRest(f"after {WAIT_S:g} s still: {last.fault}")
    raise NotAtRest(
        f"the arm does not come to rest: {1e3 * float(np.abs(last.dq_rad_s).max()):.1f} mrad/s after {WAIT_S:g} s "
        f"(limit {1e3 * REST_RAD_S:g}); take hands and objects away from it and try again"
    )


def state_of(arm: Arm) -> ArmState:
    """The arm's state, which may have a fault that a person ends by letting go. Raises ArmFault for any other fault."""
    state = arm.state()
    if state.fault is not None and not state.by_hand:
        raise ArmFault(f"the arm reports {state.fault}; clear the fault on the arm, then run again: it continues")
    return state
