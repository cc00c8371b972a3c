"""A program with a motion under way, to be killed: `python moving_program.py HOST`. Says "moving" 0.5 s into it."""

from __future__ import annotations

import sys
from typing import Self

import numpy as np
from cells import cell
from fr3_process import READY_RAD, RELAXED

from hw.franka.arm import franka
from hw.franka.settings import FrankaSettings
from hw.types import JointPath


class Held:
    """A pedal that is always held, and counts how often it was asked: once before the motion, then every 5 ms."""

    def __init__(self) -> None:
        self._asked = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None: ...

    def enabled(self) -> bool:
        self._asked += 1
        if self._asked == 100:
            sys.stdout.write("moving\n")
            sys.stdout.flush()
        return True

    def pressed(self) -> bool:
        return True

    def why_not(self) -> str:
        return ""


if __name__ == "__main__":
    t_s = np.arange(3001) / 1000
    u = t_s / t_s[-1]
    share = u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3)
    with franka(cell("fr3"), FrankaSettings(sys.argv[1]), RELAXED, pedal=Held()) as arm:
        path = JointPath(t_s, READY_RAD + share[:, None] * np.array([0.5, -0.2, 0.2, 0.2, 0.3, 0.2, -0.4]))
        arm.execute(path)
