"""What every path is checked against before an arm is asked to play it."""

from __future__ import annotations

from typing import Protocol

from hw.guarding import check_guarded, require_guarded
from hw.limits import refuse_beyond
from hw.types import Array, Guard, JointPath
from hw.workcell import Workcell


class PathCheck(Protocol):
    """Raises MotionRefused for a path, begun where the arm is now (7,) if that is given."""

    def __call__(self, path: JointPath, q_now_rad: Array | None = None) -> object:
        """Check `path`; what it returns does not matter."""
        ...


def until(guard: Guard, cell: Workcell) -> PathCheck:
    """Of a motion that ends at a touch. One that is played to its end has `Workcell.require`."""

    def check(path: JointPath, q_now_rad: Array | None = None) -> None:
        require_guarded(path, guard, cell, q_now_rad)

    return check


def back_from(guard: Guard, cell: Workcell) -> PathCheck:
    """Of the way back from there, which declares no contact any more."""

    def check(path: JointPath, q_now_rad: Array | None = None) -> None:
        refuse_beyond(check_guarded(path, guard, cell, q_now_rad))

    return check
