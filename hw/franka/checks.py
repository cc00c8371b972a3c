"""What every path is checked against before an arm is asked to play it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from hw import guarding, limits
from hw.collision import KeepOut, Table, Tool
from hw.types import Array, Guard, JointPath


class Check(Protocol):
    """Raises MotionRefused for a path, begun where the arm is now (7,) if that is given."""

    def __call__(self, path: JointPath, q_now_rad: Array | None = None) -> None: ...


@dataclass(frozen=True, eq=False)
class Checks:
    """The arm's model, what is around it, what it holds, and at which force along an axis it stops by itself."""

    model: str
    keep_out: tuple[KeepOut, ...]
    tool: Tool
    table: Table
    collision_N: float

    def free(self, path: JointPath, q_now_rad: Array | None = None) -> None:
        """`Check` of a motion that is played to its end."""
        limits.require(path, self.model, q_now_rad, *self._around)

    def until(self, guard: Guard) -> Check:
        """Of a motion that ends at a touch."""

        def check(path: JointPath, q_now_rad: Array | None = None) -> None:
            guarding.require_guarded(path, guard, self.model, q_now_rad, *self._around)

        return check

    def back_from(self, guard: Guard) -> Check:
        """Of the way back from there, which declares no contact any more."""

        def check(path: JointPath, q_now_rad: Array | None = None) -> None:
            limits.refuse_beyond(guarding.check_guarded(path, guard, self.model, q_now_rad, *self._around))

        return check

    @property
    def _around(self) -> tuple[tuple[KeepOut, ...], Tool, Table, float]:
        return self.keep_out, self.tool, self.table, self.collision_N
