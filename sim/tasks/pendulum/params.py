"""Double pendulum: the spaces, fixed numbers and hyperparameters (Tables A1 and A2 of the paper).

Point masses at the ends of two massless links of 1 m, both joints driven and viscous, linearised around upright. The
second angle is relative to the first. Our reading: Q = R = I, continuous time, start (-pi, 0, 0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.types import Array, frozen_array
from sim.tasks.task import AdaptationSettings, Observation
from sim.types import Dimension, Space

PARAMETERS = Space(
    (
        Dimension(
            "m1",
            "kg",
            1.0,
            2.0,
            plain="inner mass",
            meaning="point mass at the end of the first link",
            margin=(0.4, 2.0),
            limits=(0.05, 10.0),
        ),
        Dimension(
            "m2",
            "kg",
            1.0,
            2.0,
            plain="outer mass",
            meaning="point mass at the end of the second link",
            margin=(0.3, 2.6),
            limits=(0.05, 10.0),
        ),
        Dimension(
            "b1",
            "N m s/rad",
            1.0,
            2.0,
            plain="inner damping",
            meaning="viscous friction of the first joint",
            margin=(1.0, 10.0),
            limits=(0.0, 50.0),
        ),
        Dimension(
            "b2",
            "N m s/rad",
            1.0,
            2.0,
            plain="outer damping",
            meaning="viscous friction of the second joint",
            margin=(1.0, 10.0),
            limits=(0.0, 50.0),
        ),
    )
)
"""Omega."""

MARGIN = PARAMETERS.widened
"""Omega and everything that the targets of Table A2 reach."""

CONTEXT = Space(())
"""Empty: every trial starts from `START`."""

REFERENCE_CONTEXT: Array = frozen_array(np.zeros(0))

START: Array = frozen_array([-np.pi, 0.0, 0.0, 0.0], (4,))
"""(q1, q2) in rad and their rates in rad/s."""

ACTION = Space(
    (
        Dimension("k11", "N m/rad", 0.0, 160.0, plain="gain k11", meaning="torque of joint 1 per angle of joint 1"),
        Dimension("k12", "N m/rad", 0.0, 70.0, plain="gain k12", meaning="torque of joint 1 per angle of joint 2"),
        Dimension("k13", "N m s/rad", 0.0, 70.0, plain="gain k13", meaning="torque of joint 1 per speed of joint 1"),
        Dimension("k14", "N m s/rad", 0.0, 30.0, plain="gain k14", meaning="torque of joint 1 per speed of joint 2"),
        Dimension("k21", "N m/rad", -10.0, 100.0, plain="gain k21", meaning="torque of joint 2 per angle of joint 1"),
        Dimension("k22", "N m/rad", 0.0, 75.0, plain="gain k22", meaning="torque of joint 2 per angle of joint 2"),
        Dimension("k23", "N m s/rad", -5.0, 45.0, plain="gain k23", meaning="torque of joint 2 per speed of joint 1"),
        Dimension("k24", "N m s/rad", 0.0, 25.0, plain="gain k24", meaning="torque of joint 2 per speed of joint 2"),
    )
)
"""The feedback gain K, row by row: torques are -K x. The ranges hold every optimal gain of the margin."""

ACTION_NOISE: Array = frozen_array(np.zeros(8))

NUISANCE = Space(())

OBSERVATION = Observation(
    times_s=frozen_array(np.linspace(0.0, 2.5, 12)),
    columns=(0, 1),
    low=frozen_array([-3.5, -9.5]),
    high=frozen_array([1.5, 2.5]),
    noise_mean=frozen_array([0.0, 0.0]),
    noise_std=frozen_array([0.0, 0.0]),
    curves=("q1 [rad]", "q2 [rad]"),
)

ADAPTATION = AdaptationSettings(
    horizon=10,
    delta=0.10,
    discount=0.9,
    threshold=0.95,
    trials_per_iteration=1,
    learning_rate=3e-4,
    trial_std=0.01,  # a repeated trial has the same reward
    end_moments=3,  # the last half second (paper: twelve points of it; the state has four numbers)
)


@dataclass(frozen=True)
class PendulumUnmodelled:
    """Unmodelled effects of a world: none, because this is the control experiment."""


PLAUSIBLE: dict[str, tuple[float, float]] = {}
"""The plausible range of each unmodelled effect; see `Task.plausible`."""
