"""What every arm does before a motion, real or not: no motion out of a fault, and none beyond a limit."""

from __future__ import annotations

from hw import limits
from hw.collision import BARE_HAND, LEVEL, KeepOut, Table, Tool
from hw.errors import ArmFault
from hw.types import Array, JointPath


def refuse_while_stopped(fault: str | None) -> None:
    """Raises ArmFault while the arm is stopped by `fault`."""
    if fault is not None:
        raise ArmFault(f"the arm is stopped ({fault}); recover it before the next motion")


def refuse_unless_safe(
    path: JointPath,
    model: str,
    q_now_rad: Array,
    *,
    fault: str | None,
    keep_out: tuple[KeepOut, ...] = (),
    tool: Tool = BARE_HAND,
    table: Table = LEVEL,
    collision_N: float | None = None,
) -> None:
    """Raises ArmFault while the arm is stopped by `fault`, MotionRefused for what `hw.limits` refuses from (7,).

    `table` is where the table top is; `collision_N` the force at which this arm stops by itself, where it is known.
    """
    refuse_while_stopped(fault)
    limits.require(path, model, q_now_rad, keep_out, tool, table, collision_N)
