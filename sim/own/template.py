"""The file that `adaptsim task new` writes."""

from __future__ import annotations

_TEXT = '''"""A task of one file. Change it step by step, and run `adaptsim task check {file}` after each.

The guide is docs/guide/own-simulator.md.
"""

import adaptsim
import numpy as np


@adaptsim.task(
    # What you do not know about the real thing: (low, high, "unit"), with "log" as a fourth word for a wide range.
    parameters={{"mu": (0.1, 0.3), "mass": (0.4, 0.8, "kg")}},
    # What is known before a trial, for example where the goal is.
    context={{"goal": (0.4, 1.2, "m")}},
    # What a trial can choose.
    action={{"push": (0.5, 1.2, "N s")}},
    # What is observed, with the range that is expected.
    state={{"x": (0.0, 3.0, "m")}},
    duration=3.0,
    # From 0 to 1; below 0 counts as 0.
    reward=lambda end, context: 1 - abs(end.x - context.goal) / 0.3,
    # Targets with a known truth, to try a session before there is a robot.
    worlds={{"wd": dict(mu=0.15, mass=0.4), "heavy": dict(mu=0.28, mass=0.75)}},
)
def {name}(p, action):
    """Slide a block to a goal."""
    times = np.linspace(0.0, 3.0, 31)
    speed = action.push / p.mass
    braking = 9.81 * p.mu
    moving = np.minimum(times, speed / braking)
    return times, speed * moving - 0.5 * braking * moving**2
'''


def template(name: str) -> str:
    """The text of a task called `name`."""
    return _TEXT.format(name=name, file=f"{name}.py")
