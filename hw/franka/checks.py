"""The checks of a path before an arm plays it."""

from __future__ import annotations

from typing import Protocol

from hw.guarding import check_guarded, require_guarded
from hw.limits import refuse_beyond
from hw.types import Array, Guard, JointPath
from hw.workcell import Workcell


class PathCheck(Protocol):
    """Raises MotionRefused for a path that must not be played; given `q_now_rad` (7,), it has to begin there."""

    def __call__(self, path: JointPath, q_now_rad: Array | None = None) -> object:
        """Check `path`; the return value is not used."""
        ...


def until(guard: Guard, cell: Workcell) -> PathCheck:
    """The check of a motion that ends at a touch. A motion played to its end is checked by `Workcell.require`."""

    def check(path: JointPath, q_now_rad: Array | None = None) -> None:
        require_guarded(path, guard, cell, q_now_rad)

    return check


def back_from(guard: Guard, cell: Workcell) -> PathCheck:
    """The check of the way back from the touch, which declares no contact."""

    def check(path: JointPath, q_now_rad: Array | None = None) -> None:
        refuse_beyond(check_guarded(path, guard, cell, q_now_rad))

    return check
