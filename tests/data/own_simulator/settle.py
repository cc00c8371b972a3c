"""A plain function with everything that a task of one file may declare."""

import adaptsim
import numpy as np

FRICTION = {"ice": 0.05, "wood": 0.3, "felt": 0.5}


@adaptsim.task(
    parameters={
        "ground": ("ice", "wood", "felt"),
        "mass": (0.2, 2.0, "kg", "log"),
        "delay": (0.0, 0.1, "s"),
    },
    context={"start": (-0.2, 0.2, "m"), "goal": (0.4, 1.0, "m")},
    action={"push": (0.2, 1.5, "N s")},
    state={"x": (-0.5, 3.0, "m")},
    nuisance={"gust": (-0.05, 0.05, "m")},
    margin={"delay": (0.0, 0.15)},
    effects={"drift": (0.0, 0.0, 0.1)},
    duration=3.0,
    moments=[0.5, 1.0, 2.0, 3.0],
    measure=lambda times, states: {"end": states.x[-1], "farthest": states.x.max()},
    reward=lambda end, context: 0.0 if end.farthest > 2.5 else max(0, 1 - abs(end.end - context.goal) / 0.5),
    outcomes={"over the edge": lambda end: end.farthest > 2.5, "on the table": None},
    noise={"x": 0.002},
    action_error={"push": 0.01},
    trials=3,
    iterations=4,
    trial_std=0.2,
    worlds={"wd": dict(ground="wood", mass=0.5, delay=0.05), "far": dict(ground="ice", mass=1.0, delay=0.0, drift=0.05)},
)
def settle(p, context, action):
    """Push a block from its start to a goal."""
    times = np.linspace(0.0, 3.0, 61)
    speed, braking = action.push / p.mass, 9.81 * FRICTION[p.ground]
    moving = np.minimum(times, speed / braking)
    x = context.start + p.gust + speed * moving - 0.5 * braking * moving**2 + p.drift * times
    return adaptsim.sensor(times, x, delay=p.delay)
