"""Brings the board to its next place: the arm moves by itself, or a person guides it by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from adaptsim_cli.bench.calibration.parts import CalibrationRig
from adaptsim_cli.errors import PreflightFailed, StoppedByOperator, UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, enter, stop
from calib import poses
from calib.poses import Coverage
from hw.types import Array
from sim.errors import NotExecutable

CANDIDATES = 1024
DISTANCE_M = (0.45, 1.15)
FEWEST = 12
"""Fewest reachable places for a series."""
GUIDED = 20


class Arrival(Enum):
    """How a visit to one place ended."""

    THERE = "at the place, at rest unless a sensor says otherwise"
    LEFT_OUT = "this place failed, the next may work"
    ENOUGH = "no more places: the operator has enough"


class BoardMover(Protocol):
    """The visits of a series, one place after another."""

    def numbers(self, viewed: Set[int]) -> Sequence[int]:
        """The places to visit, in order; those in `viewed` already have a view."""

    def series(self) -> AbstractContextManager[None]:
        """A context manager around the whole series, which it announces before the first motion. Raises UsageError."""

    def go(self, number: int, have: Coverage | None) -> Arrival:
        """Bring the board to place `number` (from 0). Raises ArmFault, MotionRefused, StoppedByOperator."""

    def end(self, film: Callable[[], None]) -> None:
        """After the last place: let `film` swing the board for the time offset, and bring the arm back."""


@dataclass(frozen=True, eq=False)
class Automatic:
    """The arm visits planned postures. Each motion is planned and checked just before it begins."""

    rig: CalibrationRig
    screen: Screen
    q_rad: Array  # (P, 7) in the order of the visits
    home_rad: Array  # (7,) the arm's first posture
    unattended: bool

    def numbers(self, viewed: Set[int]) -> Sequence[int]:
        """The planned postures that have no view yet."""
        return [number for number in range(len(self.q_rad)) if number not in viewed]

    def series(self) -> AbstractContextManager[None]:
        """Announce the motions: the first one is watched, then one answer releases the others. Raises UsageError."""
        if self.unattended and self.rig.is_real:
            raise UsageError(
                "--yes never confirms the motion of a real arm; run the command in a terminal, without --yes"
            )
        if not self.unattended:
            self.screen.show("The board must be firm in the gripper. Watch the first motion: the others are like it.")
        others = f"brings the board to the other places, {len(self.q_rad)} in all, and back, without asking again"
        return self.rig.release.run("brings the board to its first place, slowly", others)

    def go(self, number: int, have: Coverage | None) -> Arrival:
        """Move to one posture, or skip it if no path leads there. Raises MotionRefused, HardwareError."""
        try:
            path = self.rig.ways.way(self.rig.arm.state().q_rad, self.q_rad[number])
        except NotExecutable as error:
            self.screen.note(f"  place {number + 1} left out: {error}")
            return Arrival.LEFT_OUT
        self.rig.arm.execute(path)
        return Arrival.THERE

    def end(self, film: Callable[[], None]) -> None:
        """Film the board in motion, then go home. Raises HardwareError."""
        film()
        try:
            self.rig.arm.execute(self.rig.ways.way(self.rig.arm.state().q_rad, self.home_rad))
        except NotExecutable as error:
            self.screen.note(f"  the arm stays where it is: {error}")
        self.rig.release.completed()


@dataclass(frozen=True, eq=False)
class HandGuided:
    """A person moves the arm and says when it is at rest."""

    screen: Screen

    def numbers(self, viewed: Set[int]) -> Sequence[int]:
        """The numbers of further views, up to as many as a person may take."""
        first = max(viewed, default=-1) + 1
        return range(first, first + GUIDED)

    def series(self) -> AbstractContextManager[None]:
        """Tell the person how to guide the arm."""
        self.screen.show(
            "Guide the arm by hand: hold the board where the hint says, let go, and press Enter. "
            "Tilt it by 20 to 40° to all sides, near and far, in all parts of the image."
        )
        return nullcontext()

    def go(self, number: int, have: Coverage | None) -> Arrival:
        """Wait until the person has placed the board, or has enough views. Raises StoppedByOperator."""
        if have is not None and have.missing:
            self.screen.note(f"  missing: {have.missing[0]}")
        enough = number >= FEWEST and have is not None and have.complete
        view = enter("when the arm is at rest", "The camera takes a picture of the board.")
        solve = (Key("s", "to solve", "The views so far are enough: the camera's pose is computed."),) if enough else ()
        way_out = stop("The command ends; the views so far are stored, and the same command goes on with them.")
        answer = self.screen.choose(f"Place {number + 1}.", view, *solve, way_out)
        if answer == "q":
            raise StoppedByOperator("stopped by the operator; the views so far are stored")
        return Arrival.ENOUGH if answer == "s" else Arrival.THERE

    def end(self, film: Callable[[], None]) -> None:
        """Does nothing, because without a planned motion there is nothing to film."""
        return  # so the time offset is not measured


def plan(rig: CalibrationRig, count: int) -> Array:
    """(P, 7) up to `count` postures that together show the board in all reachable ways.

    Deterministic for a rig and board, so that an interrupted series can continue. Raises PreflightFailed.
    """
    from sim.panda.postures import nearest_first

    if rig.rough_X_BC is None:
        raise PreflightFailed("the camera pose is still unknown, so no motion can be planned: add --guide")
    camera = rig.camera.model().colour
    X_CM = poses.candidates(camera, rig.board, CANDIDATES, DISTANCE_M)
    postures = rig.ways.postures(rig.rough_X_BC @ X_CM @ np.linalg.inv(rig.X_FM))
    able = [i for i, q in enumerate(postures) if q is not None]
    if len(able) < FEWEST:
        raise PreflightFailed(
            f"the arm can hold the board at {len(able)} of {len(X_CM)} places before the camera, but {FEWEST} are "
            "needed: check that the camera has not moved and that the board is mounted as docs/guide/calibrate.md "
            "shows; or add --guide"
        )
    chosen = [able[i] for i in poses.spread(X_CM[able], rig.board, count)]
    q_rad = np.array([postures[i] for i in chosen])
    return np.asarray(q_rad[list(nearest_first(q_rad, q_rad.mean(axis=0)))])
