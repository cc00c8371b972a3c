"""The check of every arm, real or simulated, before a motion: no fault is pending and every limit is kept."""

from __future__ import annotations

from hw.errors import ArmFault
from hw.types import Array, JointPath
from hw.workcell import Workcell


def refuse_while_stopped(fault: str | None) -> None:
    """Raises ArmFault while the arm is stopped by `fault`."""
    if fault is not None:
        raise ArmFault(f"the arm is stopped ({fault}); recover it before the next motion")


def refuse_unless_safe(path: JointPath, cell: Workcell, q_now_rad: Array, *, fault: str | None) -> None:
    """Raises ArmFault while the arm is stopped by `fault`, MotionRefused if `cell` refuses `path` from `q_now_rad`
    (7,).
    """
    refuse_while_stopped(fault)
    cell.require(path, q_now_rad)
