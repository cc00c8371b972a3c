"""The parts of the hand and of a task's tool that may touch the table in a touch-off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hw.collision import HAND, HAND_MASS, Tool
from hw.types import Array, frozen_array
from hw.wrist import FINGERTIP_M
from sim.errors import UnknownName
from sim.panda.tool import Held, held

FINGERTIP_RADIUS_M = 0.003


@dataclass(frozen=True, eq=False)
class Feeler:
    """A ball fixed to the tool (or hand) that touches first if the tool is held suitably."""

    name: str
    p_T_m: Array  # (3,) its centre in the tool frame T (of the fingertips: in the flange)
    radius_m: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "p_T_m", frozen_array(self.p_T_m, (3,), f"place of {self.name}"))


FINGERTIPS = Feeler("fingertips", np.array([0.0, 0.0, FINGERTIP_M - FINGERTIP_RADIUS_M]), FINGERTIP_RADIUS_M)


@dataclass(frozen=True)
class Touchable:
    """How the tool of a task is touched off."""

    feelers: tuple[Feeler, ...]
    centre_m: tuple[float, float]  # place on the table, in the middle of the task's work area


class Touching(Held, Protocol):
    """A tool that may have a touch-off."""

    @property
    def touchable(self) -> Touchable | None:
        """The touch-off of the tool; None: it has no feelers."""
        ...


def touchable(hardware: Touching) -> Touchable:
    """The touch-off of a tool. Raises UnknownName for a tool without feelers."""
    if hardware.touchable is None:
        raise UnknownName(
            "the tool of this task has no corners to touch the table with: write its pose into [tools] of the rig "
            "file; the table's height and slope are taken from the latest touch-off of another tool"
        )
    return hardware.touchable


def empty_hand() -> Tool:
    """The hand with closed, empty fingers: only their tips may touch."""
    return Tool("fingertips", HAND_MASS, HAND[:1], np.array([[0.0, 0.0, FINGERTIP_M]]))


def feeling(hardware: Touching) -> Tool:
    """The hand with the task's tool: only its feelers may touch. Raises UnknownName, as `touchable`."""
    lowest = np.array([f.p_T_m - [0.0, 0.0, f.radius_m] for f in touchable(hardware).feelers])
    return held(hardware.X_FT, hardware.tool_mass, hardware.keep_clear, lowest)
