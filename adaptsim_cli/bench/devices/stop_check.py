"""A measurement of the stop button: a person presses it during a slow motion; the time and distance until rest are
stored.

The motion is a swing of the first joint, or of the next one that the workcell allows, at the reduced speed of
`hw.stopping`. The measurement begins with the last command that the arm took, and ends when every joint stands still.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf
from typing import Protocol

import numpy as np

from adaptsim_cli.bench.devices.known_arm import KnownArm, StopMeasurement
from adaptsim_cli.bench.devices.recovery import offer_recovery
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.release import Release
from hw.braking import at_pace
from hw.errors import ArmFault, MotionRefused
from hw.franka.motions import BUTTON, StopReport
from hw.ports import Arm
from hw.stopping import REDUCED_M_S, reduced_pace, travel_m, worst_stop
from hw.types import Array, JointPath
from hw.workcell import Workcell

SWING_RAD = (0.8, 0.4, 0.15)
"""The swing to either side, tried in turn."""
SWING_S = 1.5
"""The time from the middle to one side, at full pace."""
JOINTS = (0, 6)
"""The joints that may swing, counted from 0, in the order in which they are tried."""


class Reporting(Protocol):
    """An arm that knows how its last motion stopped."""

    @property
    def last_stop(self) -> StopReport | None:
        """How the last motion stopped; None if it was completed."""


def swing(q_rad: Array, cell: Workcell, joints: Sequence[int] = JOINTS) -> JointPath:
    """A slow motion of one of `joints` that begins and ends at the reported joints (7,), and that `cell` allows.

    Raises MotionRefused.
    """
    refused = ""
    for path in _swings(q_rad, joints):
        slow = at_pace(path, reduced_pace(path, cell))
        try:
            cell.require(slow, q_rad)
        except MotionRefused as error:
            refused = str(error)
            continue
        return slow
    raise MotionRefused(
        f"no joint has room for the slow motion of the stop check ({refused}); guide the arm elsewhere by hand"
    )


def _swings(q_rad: Array, joints: Sequence[int] = JOINTS) -> Iterator[JointPath]:
    """The swings to one side, to the other and back, at rest at every turn."""
    u = np.arange(1, round(1000 * SWING_S) + 1) / round(1000 * SWING_S)
    step = u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
    v = np.arange(1, 2 * len(u) + 1) / (2 * len(u))
    across = 1.0 - 2.0 * v**4 * (35.0 - 84.0 * v + 70.0 * v**2 - 20.0 * v**3)
    share = np.concatenate([[0.0], step, across, step - 1.0])
    t_s = np.arange(len(share)) / 1000
    for angle_rad in SWING_RAD:
        for joint in joints:
            yield JointPath(t_s, q_rad + angle_rad * share[:, None] * np.eye(len(q_rad))[joint])


def swinging(path: JointPath) -> str:
    """The question before the swing."""
    return (
        f"The arm will swing to and fro for {path.duration_s:.0f} s, at up to {REDUCED_M_S:g} m/s. Press its stop "
        "button while it swings. Is nobody within its reach?"
    )


def measurement(stopped: StopReport, path: JointPath, cell: Workcell, operator: str) -> StopMeasurement:
    """The measured stop beside the worst case of the same motion, both for the point that moves farthest.

    The flange does not count, because joint 7 turns it in place. A report without measured joints gives an infinite
    distance, which is beyond every worst case.
    """
    worst = worst_stop(cell, (path,))
    return StopMeasurement(
        at=datetime.now(UTC).isoformat(timespec="seconds"),
        by=operator,
        time_s=stopped.still_after_s,
        distance_m=inf if stopped.q_rad is None else travel_m(stopped.q_rad, cell),
        worst_time_s=worst.time_s,
        worst_distance_m=worst.distance_m,
    )


@dataclass(frozen=True)
class StopCheck:
    """The person at the terminal, the arm behind its confirmation, and the arm that reports."""

    screen: Screen
    arm: Arm
    reporting: Reporting
    cell: Workcell
    known_arm: KnownArm
    release: Release

    def measure(self, operator: Callable[[], str]) -> StopMeasurement:
        """Have the stop button pressed during the swing, keep the measured stop, and have the button released.

        `operator` is asked for the name after the first question. Raises StoppedByOperator, MotionRefused, and ArmFault
        for another fault than the stop button.
        """
        while True:
            path = swing(self.arm.state().q_rad, self.cell)
            then = "The arm swings until you press the stop button. Enter alone moves nothing."
            self.release.one(swinging(path), path.digest, then)
            if (stopped := self._swung(path)) is not None:
                break
            self.screen.note("  The arm came to the end of its swing: the stop button was not pressed.")
        stop = measurement(stopped, path, self.cell, operator())
        self.known_arm.stop_measured(stop)
        offer_recovery(self.arm, self.screen)
        return stop

    def _swung(self, path: JointPath) -> StopReport | None:
        try:
            self.arm.execute(path)
        except ArmFault:
            stopped = self.reporting.last_stop
            if stopped is None or stopped.why != BUTTON:
                raise
            return stopped
        return None
