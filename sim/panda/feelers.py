"""What of the hand and of a task's tool may touch the table in a touch-off, and which task has what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.collision import HAND, HAND_MASS, Tool
from hw.types import Array, frozen_array
from sim.errors import UnknownName
from sim.panda.tool import held
from sim.tasks.scooping.params import BLADE_LENGTH_M, BLADE_WIDTH_M, CORNER_M, EDGE_M
from sim.tasks.task import Task

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

_SIDE_M = (BLADE_WIDTH_M - EDGE_M) / 2.0
_DOWN_M = -EDGE_M + CORNER_M

BLADE: tuple[Feeler, ...] = tuple(
    Feeler(f"{side} corner of the {end}", np.array([x_m, y_m, _DOWN_M]), CORNER_M)
    for end, x_m in (("edge", 0.0), ("heel", -BLADE_LENGTH_M))
    for side, y_m in (("left", _SIDE_M), ("right", -_SIDE_M))
)
"""The blade's lower corners: two at its leading edge, two at its root."""


@dataclass(frozen=True)
class Touchable:
    """How the tool of a task is touched off."""

    feelers: tuple[Feeler, ...]
    centre_m: tuple[float, float]  # where on the table, in the middle of the task's work area


TOUCHABLE: dict[str, Touchable] = {"scooping": Touchable(BLADE, (0.66, 0.0))}
"""By task. A tool of another task: add its corners here."""


def touchable(task: Task) -> Touchable:
    """Raises UnknownName for a task whose tool has nothing to touch with."""
    if task.name not in TOUCHABLE:
        raise UnknownName(
            f"the tool of {task.name} has no corners to touch the table with; a touch-off is for {', '.join(TOUCHABLE)}"
        )
    return TOUCHABLE[task.name]


def feelers_of(task: Task) -> tuple[Feeler, ...]:
    """Raises UnknownName, as `touchable`."""
    return touchable(task).feelers


def empty_hand() -> Tool:
    """The hand with its fingers closed on nothing: only their tips may touch."""
    return Tool("fingertips", HAND_MASS, HAND[:1], np.array([[0.0, 0.0, FINGERTIP_M]]))


def feeling(task: Task, X_FT: Array) -> Tool:
    """The hand with the task's tool at `X_FT` (4, 4): only its feelers may touch."""
    lowest = np.array([f.p_T_m - [0.0, 0.0, f.radius_m] for f in feelers_of(task)])
    return held(X_FT, task.tool_mass, task.keep_clear, lowest, f"tool of {task.name}")
