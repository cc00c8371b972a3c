"""Scooping: the spaces, fixed numbers and hyperparameters (Tables A1 and A2 and A4.2 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from hw.types import Array, frozen_array
from sim.errors import OutOfRange
from sim.tasks.task import AdaptationSettings, Observation, ReuseRules
from sim.types import Dimension, Space

PARAMETERS = Space(
    (
        Dimension(
            "mu",
            "",
            0.25,
            0.40,
            plain="friction",
            meaning="friction coefficient between piece and table, and between piece and blade",
            margin=(0.15, 0.50),
        ),
        Dimension(
            "e",
            "Pa",
            1e4,
            5e5,
            "log",
            plain="piece stiffness",
            meaning="hydroelastic modulus of the piece; a low value is a soft piece",
            margin=(5e3, 1e6),
        ),
        Dimension("g", "", 0, 1, "integer", plain="shape", meaning="0 ellipsoid, 1 cylinder, 2 box", margin=(0, 2)),
        Dimension("h", "cm", 1.5, 2.5, plain="piece height", meaning="height of the piece", margin=(1.2, 3.0)),
    )
)
"""Omega."""

MARGIN = PARAMETERS.widened
"""Omega and everything that the targets of Table A2 reach."""

CONTEXT = Space(
    (
        Dimension(
            "x",
            "m",
            0.625,
            0.705,
            plain="piece ahead",
            meaning="how far ahead of the arm's base the near side of the piece lies",
        ),
        Dimension(
            "y",
            "m",
            -0.03,
            0.03,
            plain="piece left",
            meaning="how far to the robot's left the centre of the piece lies",
        ),
    )
)
"""Place of the middle of the piece's near side on the table, in the base frame.

The centres of the largest pieces of training lie in the 8 x 6 cm of the public code, X 0.64 to 0.72 m. The near side
decides where the blade starts, so a piece of any size is scooped alike."""

ACTION = Space(
    (
        Dimension(
            "pitch_rate",
            "rad/s",
            -0.2,
            0.2,
            plain="pitch rate",
            meaning="turning speed of the blade at 0.25 s; positive leaves the table late",
        ),
        Dimension(
            "pitch",
            "rad",
            float(np.deg2rad(2.0)),
            float(np.deg2rad(10.0)),
            plain="initial pitch",
            meaning="angle of the blade at the start, edge down",
        ),
        Dimension(
            "distance",
            "m",
            0.005,
            0.020,
            plain="initial distance",
            meaning="from the blade's edge to the near side of the piece",
        ),
    )
)

NUISANCE = Space((Dimension("radius", "m", 0.010, 0.015, plain="piece radius", meaning="half the width of the piece"),))
"""Half the width of the piece, which differs from piece to piece."""

ACTION_NOISE: Array = frozen_array([0.04, 0.012, 0.0], (3,))
"""Half-width of the uniform error of an executed action, in the order of `ACTION`."""

REFERENCE_CONTEXT: Array = frozen_array([0.665, 0.0], (2,))

OBSERVATION_TIMES_S: Array = frozen_array([0.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0])

OBSERVATION = Observation(
    times_s=OBSERVATION_TIMES_S,
    columns=(0, 1),
    low=frozen_array([0.60, -0.08]),
    high=frozen_array([1.00, 0.08]),
    noise_mean=frozen_array([0.002, 0.0]),  # motion blur pulls the piece forward
    noise_std=frozen_array([0.002, 0.002]),
)

ADAPTATION = AdaptationSettings(
    horizon=8, delta=0.15, discount=0.9, threshold=0.5, trials_per_iteration=2, learning_rate=1e-3
)
REUSE = ReuseRules(0.16, first_budget=1_200, least_budget=300, max_budget=4_000, discount=0.9)
"""Table A1; the least budget is ours."""

EDGE_M = 0.0012
"""Thickness of the blade (OXO Nylon Square Turner)."""

BEVEL_M = 0.005
LIP_M = 0.0002
"""The top face of training's blade is bevelled over the last `BEVEL_M` down to a lip of `LIP_M` (docs/decisions/0003).
"""

SQUARE_LIP_M = 0.0011
"""The highest lip, which is a square edge without a bevel. The underside lies 0.1 mm above the corners that ride on the
table, so that only these touch it."""

EDGE_STIFFNESS_N_M = 2e5
"""Stiffness of each corner of the edge against the table in training: nearly rigid."""

CORNER_M = 0.0003
"""Radius of the rounded corners of the edge, on which the blade rides over the table."""

PIECE_DENSITY_KG_M3 = 1000.0
"""Food is mostly water."""

WRIST_IN_TOOL_M: Array = frozen_array([-0.177, 0.0, 0.143], (3,))
"""The wrist point, for which the profile prescribes the velocity, in the tool frame T (public code)."""

HOME_PITCH_RAD = -0.10
"""Pitch of the blade between trials: tilted back, so that a round piece stays at its root."""


@dataclass(frozen=True)
class ScoopingUnmodelled:
    """Effects of a lab's world that no simulation parameter expresses. The defaults are those of the training scene."""

    semi_axis_scale: tuple[float, float] = (1.0, 1.0)  # half widths of the piece along X and Y, relative to its radius
    density_scale: float = 1.0
    com_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # centre of mass from the piece's centre
    second_friction_scale: float = 1.0  # friction piece-blade relative to piece-table
    pitch_bias_rad: float = 0.0  # added to the pitch of the whole motion, about the edge; positive: edge down
    blade_flex_rad: float = 0.0  # bend of the blade when pressed into the table by the full depth
    distance_bias_m: float = 0.0  # the edge starts this much farther from the piece than commanded
    edge: tuple[float, float] = (LIP_M, EDGE_STIFFNESS_N_M)  # height of the lip (m), stiffness of each corner (N/m)
    colour: tuple[float, float, float] = (0.55, 0.13, 0.03)  # of the piece in pictures, linear RGB
    contact: Literal["sap", "lagged"] = "sap"
    dt_s: float | None = None  # step of the plant; None: the step of training

    def __post_init__(self) -> None:
        positive = {
            "semi_axis_scale": min(self.semi_axis_scale),
            "density_scale": self.density_scale,
            "second_friction_scale": self.second_friction_scale,
            "stiffness in edge": self.edge_stiffness_N_m,
            "dt_s": 1.0 if self.dt_s is None else self.dt_s,
        }
        for name, value in positive.items():
            if not value > 0.0:
                raise OutOfRange(f"{name} = {value:g} must be positive")
        if self.second_friction_scale >= 2.0:
            raise OutOfRange(f"second_friction_scale = {self.second_friction_scale:g} must stay below 2")
        if not 0.0 < self.lip_m <= SQUARE_LIP_M:
            raise OutOfRange(f"lip in edge = {self.lip_m:g} must be positive and at most {SQUARE_LIP_M:g} m")
        if not all(0.0 <= part <= 1.0 for part in self.colour):
            raise OutOfRange(f"colour = {self.colour} must have three parts between 0 and 1")
        if self.blade_flex_rad < 0.0:
            raise OutOfRange(f"blade_flex_rad = {self.blade_flex_rad:g} must not be negative: the table bends it up")
        if self.contact not in ("sap", "lagged"):
            raise OutOfRange(f'contact = "{self.contact}" must be "sap" or "lagged"')

    @property
    def lip_m(self) -> float:
        """Height of the blunt lip in front of the bevel, which keeps its slope."""
        return self.edge[0]

    @property
    def edge_stiffness_N_m(self) -> float:
        """Stiffness of each corner of the edge against the table."""
        return self.edge[1]

    def friction_of_blade(self, mu: float) -> float:
        """The coefficient of the blade with which the pair of blade and piece (coefficient `mu`) has
        `second_friction_scale * mu`.

        Drake combines two coefficients harmonically, 2ab / (a + b), so a pair never exceeds 2 mu.
        """
        scale = self.second_friction_scale
        return scale * mu / (2.0 - scale)


PLAUSIBLE: dict[str, tuple[Any, Any]] = {
    "semi_axis_scale": ((0.8, 0.8), (1.3, 1.3)),
    "density_scale": (0.5, 1.5),
    "com_offset_m": ((-0.003, -0.002, -0.003), (0.003, 0.002, 0.003)),
    "second_friction_scale": (0.4, 1.4),
    "pitch_bias_rad": (-0.06, 0.06),
    "blade_flex_rad": (0.0, 0.12),
    "distance_bias_m": (-0.004, 0.008),
    "edge": ((LIP_M, 1.5e3), (SQUARE_LIP_M, 4e3)),
    "contact": ("sap", "lagged"),
}
"""The plausible range of each effect. The contact law is that of training or the other one."""


STEP_S = 0.0025
BLUNT_STEP_S = 0.001
"""Time step if the lip is higher than in training, so that a piece has to climb it (docs/decisions/0012)."""


def time_step_s(unmodelled: ScoopingUnmodelled | None) -> float:
    """The time step of the plant for `build_scene`, s."""
    effects = unmodelled or ScoopingUnmodelled()
    return effects.dt_s or (BLUNT_STEP_S if effects.lip_m > LIP_M else STEP_S)
