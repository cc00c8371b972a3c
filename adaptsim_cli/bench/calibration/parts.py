"""The parts of a calibration; `bench.calibration_in_use` provides them, tests bring their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from adaptsim_cli.config import is_simulated
from adaptsim_cli.screen.release import Release
from hw.ports import Arm, Camera
from hw.types import Array, JointPath
from perception.board.types import Board


@dataclass(frozen=True, eq=False)
class Ways:
    """How the arm moves the board."""

    postures: Callable[[Array], Sequence[Array | None]]
    """Flange poses X_BF (N, 4, 4) -> postures (7,) that keep clear of everything; None: no such posture."""
    way: Callable[[Array, Array], JointPath]
    """(posture (7,), posture (7,)) -> a path between them. Raises NotExecutable."""


class BoardHandler(Protocol):
    """The simulated lab's stand-in for the person who lays the board down and guides the tip."""

    def lay_board(self) -> None:
        """Take the board out of the gripper and lay it in view, face up; put a pointed tip into the gripper."""

    def touch(self, p_M_m: Array, number: int) -> None:
        """Bring the tip to the point (3,) of the board, with another tilt for each `number` from 0."""


@dataclass(frozen=True, eq=False)
class CalibrationRig:
    """The connected devices of one bench, the board in the gripper."""

    name: str  # "fake", "panda", "fr3" or "fr3v2"
    title: str  # its name for an operator
    key: str  # the folder name of its calibrations
    arm: Arm
    camera: Camera
    board: Board
    X_FM: Array  # (4, 4) planned pose of the board; only for planning
    rough_X_BC: Array | None  # (4, 4) rough pose of the camera; only for planning; None: the arm is guided by hand
    ways: Ways
    pause: Callable[[float], None]  # seconds; the simulated lab does not wait
    hands: BoardHandler | None = None  # None: a person at the terminal
    release: Release = field(default_factory=Release)  # the questions that let the arm move

    @property
    def is_real(self) -> bool:
        """Whether a real arm moves, which can hurt somebody."""
        return not is_simulated(self.name)

    def temperatures_C(self) -> dict[str, float]:
        """Temperatures in °C of "arm" and "camera", if reported."""
        devices = {"arm": self.arm, "camera": self.camera}
        temperatures = {name: getattr(device, "temperature_C", None) for name, device in devices.items()}
        return {name: value for name, value in temperatures.items() if value is not None}
