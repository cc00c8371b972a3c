"""Whether the arm at rest feels the load that it was told, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hw.errors import MotionRefused
from hw.kinematics import jacobian
from hw.types import Array

GRAVITY_M_S2 = 9.81
UNDECLARED_KG = 0.5
"""A larger difference stops the first motion. A torque error of 0.8 Nm in every joint counts as 0.2 kg."""
READINGS = 100
"""States to average, one per millisecond, after as many in which the arm's estimate settles."""


def undeclared_kg(q_rad: Array, external_Nm: Array, com_F_m: Array) -> float:
    """The mass in kg at `com_F_m` (3,) in the flange that best explains external torques (7,) at true joints (7,)."""
    per_kg = GRAVITY_M_S2 * jacobian(q_rad, com_F_m)[2]
    return float(abs(per_kg @ external_Nm) / (per_kg @ per_kg))


def require_declared(model: str, q_rad: Array, external_Nm: Sequence[Sequence[float]], com_F_m: Array) -> None:
    """`external_Nm` (N, 7) at rest, the payload set. Raises MotionRefused if the arm feels another load."""
    felt_kg = undeclared_kg(q_rad, np.mean(np.asarray(external_Nm), axis=0), com_F_m)
    if felt_kg > UNDECLARED_KG:
        raise MotionRefused(
            f"{model}: at rest the arm feels {felt_kg:.2f} kg more or less than the declared payload (at most "
            f"{UNDECLARED_KG:g} kg); nothing has moved. Correct the payload in the rig file and the end effector in "
            "Desk, or clear what leans on the arm: guide it free by hand"
        )
