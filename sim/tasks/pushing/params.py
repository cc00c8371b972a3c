"""Pushing: the spaces, fixed numbers and hyperparameters (Tables A1 and A2 and A4.1 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from hw.types import Array, frozen_array
from sim.errors import OutOfRange
from sim.tasks.task import AdaptationSettings, Mirror, Observation, ReuseRules
from sim.types import Dimension, Space

PARAMETERS = Space(
    (
        Dimension(
            "mu",
            "",
            0.05,
            0.20,
            plain="table friction",
            meaning="friction coefficient between bottle and table",
            margin=(0.04, 0.32),
        ),
        Dimension(
            "e",
            "Pa",
            1e4,
            1e6,
            "log",
            plain="band stiffness",
            meaning="hydroelastic modulus of the rubber band around the bottle; a low value is a soft band",
            margin=(8e3, 6e6),
        ),
        Dimension(
            "mu_p",
            "",
            0.2,
            0.8,
            plain="patch friction",
            meaning="friction coefficient between bottle and patch",
            margin=(0.08, 0.95),
        ),
        Dimension(
            "y_p",
            "m",
            -0.10,
            0.10,
            plain="patch position",
            meaning="where the centre of the patch lies across the table; positive is the robot's left",
            margin=(-0.16, 0.16),
            mirror=-1,
        ),
    )
)
"""Omega."""

MARGIN = PARAMETERS.widened
"""Omega and everything that the targets of Table A2 reach."""

CONTEXT = Space(
    (
        Dimension(
            "goal_x", "m", 0.70, 1.00, plain="goal distance", meaning="how far ahead of the arm's base the goal lies"
        ),
        Dimension(
            "goal_bearing",
            "rad",
            -float(np.deg2rad(10.0)),
            float(np.deg2rad(10.0)),
            plain="goal bearing",
            meaning="direction of the goal, seen from the bottle's start; positive is left",
        ),
    )
)
"""The goal. The paper's region is a wedge: X in [0.7, 1.0] m and at most 10° off the centre line as seen from the
bottle's start. In X and bearing the wedge is a box. A box in X and Y would contain goals 36° off, or crowd goals at its
rim if it were clipped. `goal_m` converts to metres, for people and for rewards."""

ACTION = Space(
    (
        Dimension(
            "yaw",
            "rad",
            -0.3,
            0.3,
            plain="push direction",
            meaning="angle of the push in the plane of the table; positive is left",
            mirror=-1,
        ),
        Dimension(
            "speed",
            "m/s",
            0.4,
            0.8,
            plain="push speed",
            meaning="forward speed of the plate while it touches the bottle",
        ),
    )
)
"""Direction of the push about the bottle's start, positive to the left, and the plate's speed along it."""

NUISANCE = Space(
    (
        Dimension(
            "placed_x",
            "m",
            -0.0035,
            0.0035,
            plain="placement error ahead",
            meaning="how far ahead of its mark the bottle was put down",
        ),
        Dimension(
            "placed_y",
            "m",
            -0.0035,
            0.0035,
            plain="placement error left",
            meaning="how far left of its mark the bottle was put down",
            mirror=-1,
        ),
    )
)
"""Offset of the bottle from `START_M`.

Every corner passes the 5 mm check before a motion; the spread of 2 mm is that of a steady hand."""

ACTION_NOISE: Array = frozen_array([0.01, 0.01], (2,))
"""Half-width of the uniform error of an executed action, in the order of `ACTION`. It is our choice, because the paper
states none here."""

REFERENCE_CONTEXT: Array = frozen_array([0.85, 0.0], (2,))

OBSERVATION_TIMES_S: Array = frozen_array(1.3 * np.arange(1, 7) / 6)
"""Six evenly spaced moments within 1.3 s, without time 0, when the bottle always stands at the start."""

OBSERVATION = Observation(
    times_s=OBSERVATION_TIMES_S,
    columns=(0, 1),
    low=frozen_array([0.50, -0.30]),
    high=frozen_array([1.30, 0.30]),
    noise_mean=frozen_array([0.0, 0.0]),
    noise_std=frozen_array([0.001, 0.001]),  # error of tracking a bottle in a point cloud
)

MIRROR = Mirror(
    parameters=PARAMETERS.mirror,
    action=ACTION.mirror,
    nuisance=NUISANCE.mirror,
    observed=frozen_array([1.0, -1.0]),
    end_state=frozen_array([1.0, -1.0]),
)
"""A push to the left, with the patch on the left, ends where the same push to the right ends, mirrored."""

ADAPTATION = AdaptationSettings(
    horizon=8, delta=0.15, discount=0.9, threshold=0.8, trials_per_iteration=2, learning_rate=3e-4
)
REUSE = ReuseRules(0.16, first_budget=10_000, least_budget=2_500, max_budget=30_000, discount=0.9)
"""Table A1; the least budget is ours."""

START_M: Array = frozen_array([0.56, 0.0], (2,))
"""The bottle's place before the push."""

BOTTLE_RADIUS_M = 0.03
BOTTLE_HEIGHT_M = 0.10
BOTTLE_MASS_KG = 0.3
COM_HEIGHT_M = 0.035
"""Centre of mass over the table: a small glass bottle, two thirds full of water (docs/decisions/0012)."""

BASE_HEIGHT_M = 0.02
BASE_RADIUS_M = 0.028
BASE_E_PA = 1e7
"""The hard base below the rubber band. It stands on the table; the plate meets the band (paper, A4.1)."""

TIPPED_RAD = float(np.deg2rad(30.0))
"""A bottle that leans more than this counts as fallen."""

PATCH_X_M = 0.75
PATCH_SIZE_M = 0.10
"""A square of other friction, centred at (`PATCH_X_M`, y_p)."""

PLATE_FRICTION = 0.3
"""Friction of the pair bottle-plate."""

GOAL_SCALE_M = 0.20
"""Distance from the goal at which the reward reaches 0."""


def goal_m(context: Array) -> Array:
    """(..., 2) contexts -> (..., 2) goal (x, y) on the table in the base frame."""
    x_m, bearing_rad = context[..., 0], context[..., 1]
    return np.stack([x_m, START_M[1] + (x_m - START_M[0]) * np.tan(bearing_rad)], axis=-1)


@dataclass(frozen=True)
class PushingUnmodelled:
    """Effects of a lab's world that no simulation parameter expresses. The defaults are those of the training scene."""

    bottle_mass_scale: float = 1.0
    com_height_m: float = COM_HEIGHT_M  # of the part that does not slosh, above the bottom
    slosh_share: float = 0.0  # share of the bottle's mass that moves to and fro, like the liquid of a half-full bottle
    slosh_height_m: float = 0.03  # of that mass above the bottom
    patch_size_scale: float = 1.0
    table_tilt_rad: tuple[float, float] = (0.0, 0.0)
    """Turn of table and arm from level about X (the left side goes up), then about Y (the far end goes down)."""
    plate_restitution_scale: float = 1.0  # divides the dissipation of the bottle's contacts
    contact: Literal["sap", "lagged"] = "lagged"
    dt_s: float | None = None  # step of the plant; None: the step of training

    def __post_init__(self) -> None:
        for name in ("bottle_mass_scale", "patch_size_scale", "plate_restitution_scale"):
            if not getattr(self, name) > 0.0:
                raise OutOfRange(f"{name} = {getattr(self, name):g} must be positive")
        if self.dt_s is not None and not self.dt_s > 0.0:
            raise OutOfRange(f"dt_s = {self.dt_s:g} must be positive")
        for name in ("com_height_m", "slosh_height_m"):
            if not 0.0 < getattr(self, name) < BOTTLE_HEIGHT_M:
                raise OutOfRange(
                    f"{name} = {getattr(self, name):g} lies outside of the bottle, 0 to {BOTTLE_HEIGHT_M} m"
                )
        if not 0.0 <= self.slosh_share <= 0.9:
            raise OutOfRange(
                f"slosh_share = {self.slosh_share:g} must lie in [0, 0.9]: the bottle itself weighs something"
            )
        if max(map(abs, self.table_tilt_rad)) > 0.3:
            raise OutOfRange(f"table_tilt_rad = {self.table_tilt_rad} is steeper than 0.3 rad: give a flatter one")
        if self.contact not in ("sap", "lagged"):
            raise OutOfRange(f'contact = "{self.contact}" must be "sap" or "lagged"')


PLAUSIBLE: dict[str, tuple[Any, Any]] = {
    "bottle_mass_scale": (0.3, 3.0),
    "com_height_m": (0.025, 0.05),
    "slosh_share": (0.0, 0.5),
    "patch_size_scale": (0.6, 1.5),
    "table_tilt_rad": ((-0.04, -0.04), (0.04, 0.04)),
    "plate_restitution_scale": (1.0, 10.0),
    "contact": ("lagged", "sap"),
}
"""The plausible range of each effect. The contact law is that of training or the other one."""


STEP_S = 0.0025


def time_step_s(unmodelled: PushingUnmodelled | None) -> float:
    """The time step of the plant for `build_scene`, s."""
    return STEP_S if unmodelled is None or unmodelled.dt_s is None else unmodelled.dt_s
