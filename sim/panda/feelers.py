"""What of the hand and of a task's tool may touch the table in a touch-off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hw.collision import HAND, HAND_MASS, Capsule, Tool
from hw.mass import Mass
from hw.types import Array, frozen_array
from sim.errors import UnknownName
from sim.panda.tool import held

FINGERTIP_M = 0.1034
"""From the flange to the ends of the Franka Hand's fingers (the maker's data sheet)."""
FINGERTIP_RADIUS_M = 0.003


@dataclass(frozen=True, eq=False)
class Feeler:
    """A ball fixed to the tool (or to the hand) that touches first if the tool is held accordingly."""

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
    centre_m: tuple[float, float]  # where on the table, in the middle of the task's work area


class Touching(Protocol):
    """All of a task that a touch-off asks for."""

    @property
    def name(self) -> str: ...
    @property
    def keep_clear(self) -> tuple[Capsule, ...]: ...
    @property
    def tool_mass(self) -> Mass: ...
    @property
    def touchable(self) -> Touchable | None: ...


def touchable(task: Touching) -> Touchable:
    """Raises UnknownName for a task whose tool has nothing to touch with."""
    if task.touchable is None:
        raise UnknownName(
            f"the tool of {task.name} has no corners to touch the table with, so it cannot be touched off"
        )
    return task.touchable


def feelers_of(task: Touching) -> tuple[Feeler, ...]:
    """Raises UnknownName, as `touchable`."""
    return touchable(task).feelers


def empty_hand() -> Tool:
    """The hand with its fingers closed on nothing: only their tips may touch."""
    return Tool("fingertips", HAND_MASS, HAND[:1], np.array([[0.0, 0.0, FINGERTIP_M]]))


def feeling(task: Touching, X_FT: Array) -> Tool:
    """The hand with the task's tool at `X_FT` (4, 4): only its feelers may touch."""
    lowest = np.array([f.p_T_m - [0.0, 0.0, f.radius_m] for f in feelers_of(task)])
    return held(X_FT, task.tool_mass, task.keep_clear, lowest, f"tool of {task.name}")
