"""A task's tool in the hand: its workcell, its feelers in a touch-off, and the corrections from a touch-off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from hw.capsules import Capsule
from hw.collision import HAND_MASS, LEVEL, Table, Tool, hand_with
from hw.kinematics import FLANGE
from hw.mass import Mass
from hw.poses import pose
from hw.types import Array, frozen_array
from sim.errors import UnknownName
from sim.types import ToolMotion

if TYPE_CHECKING:
    from hw.workcell import Workcell


@dataclass(frozen=True, eq=False)
class Feeler:
    """A ball fixed to the tool that touches the table first if the tool is held suitably."""

    name: str
    p_T_m: Array  # (3,) its centre in the tool frame T, or in the flange
    radius_m: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "p_T_m", frozen_array(self.p_T_m, (3,), f"place of {self.name}"))


@dataclass(frozen=True)
class Touchable:
    """How the tool of a task is touched off."""

    feelers: tuple[Feeler, ...]
    centre_m: tuple[float, float]  # place on the table, in the middle of the task's work area
    held_m: float  # width of the tool between the fingers


class Held(Protocol):
    """The tool of a task in the hand."""

    @property
    def X_FT(self) -> Array:
        """(4, 4) the tool in the flange."""

    @property
    def tool_mass(self) -> Mass:
        """Mass in the tool frame, without the hand."""

    @property
    def keep_clear(self) -> tuple[Capsule, ...]:
        """Capsules that must stay clear, in the tool frame."""

    @property
    def may_touch(self) -> tuple[Capsule, ...]:
        """Capsules that may touch the table but nothing else, in the tool frame."""

    @property
    def touchable(self) -> Touchable | None:
        """The touch-off of the tool; None: it has no feelers."""


def held(
    X_FT: Array,
    mass_T: Mass,
    capsules_T: tuple[Capsule, ...] = (),
    points_T_m: ArrayLike = ((0.0, 0.0, 0.0),),
    touching_T: tuple[Capsule, ...] = (),
) -> Tool:
    """The hand with a tool at X_FT (4, 4), which has the mass `mass_T` in the tool frame.

    `capsules_T`, in the tool frame, must stay clear of arm, table and boxes. `touching_T` must stay clear of arm and
    boxes, but may touch the table, first with the points `points_T_m` (P, 3) in the tool frame.
    """

    def in_flange(p_T_m: ArrayLike) -> Array:
        return np.asarray(np.asarray(p_T_m, dtype=np.float64) @ X_FT[:3, :3].T + X_FT[:3, 3])

    def carried(capsules: tuple[Capsule, ...]) -> tuple[Capsule, ...]:
        moved = (replace(c, link=FLANGE, start_m=in_flange(c.start_m), end_m=in_flange(c.end_m)) for c in capsules)
        return tuple(moved)

    mass = HAND_MASS + mass_T.placed(X_FT)
    return hand_with(mass, carried(capsules_T), in_flange(np.atleast_2d(points_T_m)), carried(touching_T))


def tool_of(hardware: Held) -> Tool:
    """The hand with the task's tool at `hardware.X_FT`."""
    return held(hardware.X_FT, hardware.tool_mass, hardware.keep_clear, touching_T=hardware.may_touch)


def cell_as_shipped(hardware: Held, model: str) -> Workcell:
    """The arm `model` with the task's tool over a level table at z = 0, with nothing around it and without joint
    errors.
    """
    from hw.workcell import STOPS_AT_N, STOPS_AT_NM, Workcell, arm_model  # noqa: PLC0415 - slow to import, and tasks are named without an arm

    return Workcell(arm_model(model, np.zeros(7)), tool_of(hardware), LEVEL, (), STOPS_AT_N, np.array(STOPS_AT_NM))


def touchable(hardware: Held) -> Touchable:
    """The touch-off of a tool. Raises UnknownName for a tool without feelers."""
    if hardware.touchable is None:
        raise UnknownName(
            "the tool of this task has no corners to touch the table with: write its pose into [tools] of the rig "
            "file; the table's height and slope are taken from the latest touch-off of another tool"
        )
    return hardware.touchable


def feeling(hardware: Held) -> Tool:
    """The hand with the task's tool: only its feelers may touch. Raises UnknownName, as `touchable`."""
    lowest = np.array([f.p_T_m - [0.0, 0.0, f.radius_m] for f in touchable(hardware).feelers])
    return held(hardware.X_FT, hardware.tool_mass, hardware.keep_clear, lowest, hardware.may_touch)


@dataclass(frozen=True)
class ToolCorrection:
    """The measured corrections; the default is none.

    The corrections of the tool are in its designed frame T, about the origin of T.
    """

    table: Table = LEVEL
    height_m: float = 0.0  # along Z of T
    forward_m: float = 0.0  # along X of T
    pitch_rad: float = 0.0  # about Y of T; positive: edge down
    roll_rad: float = 0.0  # about X of T; positive: left side up

    def X_FT(self, designed: Array) -> Array:
        """(4, 4) the tool in the flange, from its `designed` pose."""
        from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, and every task imports this module

        R = Rotation.from_euler("XY", [self.roll_rad, self.pitch_rad]).as_matrix()
        return np.asarray(designed @ pose(R, [self.forward_m, 0.0, self.height_m]))

    @property
    def X_BW(self) -> Array:
        """(4, 4) the table's frame W, used by tasks and cameras, in the arm's base B."""
        return self.table.X_BW

    @property
    def X_WB(self) -> Array:
        """(4, 4) the inverse of `X_BW`."""
        return np.asarray(np.linalg.inv(self.table.X_BW))

    def in_base(self, motion: ToolMotion) -> ToolMotion:
        """A task's motion over the table, converted to the arm's base frame."""
        return ToolMotion(motion.t_s, self.X_BW @ motion.X_BT, motion.contact)
