"""What a calibration asks of its parts; `wiring` fills these in, tests bring their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from adaptsim_cli.config import is_simulated
from hw.ports import Arm, Camera
from hw.types import Array, JointPath
from perception.board.types import Board


@dataclass(frozen=True, eq=False)
class Ways:
    """How the arm carries the board about."""

    postures: Callable[[Array], Sequence[Array | None]]
    """Flange poses X_BF (N, 4, 4) -> postures (7,) that keep clear of everything, None where there is none."""
    order: Callable[[Array, Array], Sequence[int]]
    """Postures (N, 7) and where the arm is (7,) -> in which order to visit them."""
    way: Callable[[Array, Array], JointPath]
    """From one posture (7,) to another. Raises NotExecutable."""


@runtime_checkable
class Thermometer(Protocol):
    """A device that tells how warm it is. A device need not be one."""

    @property
    def temperature_C(self) -> float | None:
        """None where it cannot tell at present."""
        ...


class Hands(Protocol):
    """Who lays the board on the table and guides the tip by hand, where it is not a person: the simulated lab."""

    def lay_board(self) -> None:
        """Take the board out of the gripper and lay it in view, face up; put a pointed tip into the gripper."""
        ...

    def touch(self, p_M_m: Array, number: int) -> None:
        """Bring the tip to that point (3,) of the board, leaning to another side for each `number` from 0."""
        ...


@dataclass(frozen=True, eq=False)
class CalibrationRig:
    """The connected devices of one bench, the board in the gripper."""

    name: str  # "fake", "panda" or "fr3"
    title: str  # what an operator calls it
    key: str  # the folder name of its calibrations
    arm: Arm
    camera: Camera
    board: Board
    X_FM: Array  # (4, 4) as the board is meant to be held; only for planning
    rough_X_BC: Array | None  # (4, 4) about where the camera stands; only for planning; None: the arm is guided by hand
    ways: Ways
    flange: Callable[[Array], Array]  # joints (..., 7) -> X_BF (..., 4, 4)
    pause: Callable[[float], None]  # seconds; the simulated lab does not wait
    hands: Hands | None = None  # None: a person at the terminal

    @property
    def is_real(self) -> bool:
        """Whether its arm can hurt somebody."""
        return not is_simulated(self.name)

    def temperatures_C(self) -> dict[str, float]:
        """Of those of "arm" and "camera" that tell it now."""
        told = {
            name: device.temperature_C
            for name, device in (("arm", self.arm), ("camera", self.camera))
            if isinstance(device, Thermometer)
        }
        return {name: value for name, value in told.items() if value is not None}
