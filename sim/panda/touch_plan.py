"""The probes of a touch-off: five places of the table, and the tool's corners at two pitches each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from hw.types import Array
from sim.panda.feelers import FINGERTIPS, Feeler
from sim.panda.touching import Probe

AROUND_M = ((-0.10, -0.16), (-0.10, 0.16), (0.06, 0.16), (0.06, -0.16), (-0.02, 0.0))
"""Places of the table around the work area's centre, along X and Y."""
PITCHES_DEG = (5.0, 18.0)
"""One pitch near that of the task, for the height, and one that shows the corner's place along the blade."""
ROLL_DEG = 3.0
"""Roll to one side: one corner is 4 mm lower than the other, over 80 mm."""

_STRAIGHT_DOWN = np.diag([1.0, -1.0, -1.0])


def table_probes(centre_m: ArrayLike) -> tuple[Probe, ...]:
    """Probes with the closed fingers straight down, around `centre_m` (2,)."""
    centre = np.asarray(centre_m, dtype=np.float64)
    return tuple(
        Probe(f"table place {i}", FINGERTIPS, centre + np.array(off), _STRAIGHT_DOWN)
        for i, off in enumerate(AROUND_M, start=1)
    )


def tool_probes(feelers: Sequence[Feeler], centre_m: ArrayLike) -> tuple[Probe, ...]:
    """Every corner of the tool at every pitch: front corners pitched down, rear corners up, each rolled to its own
    side.
    """
    middle_x = float(np.mean([f.p_T_m[0] for f in feelers]))
    return tuple(
        Probe(f"{f.name} at {pitch:g}°", f, np.asarray(centre_m, dtype=np.float64), _held(f, pitch, middle_x))
        for pitch in PITCHES_DEG
        for f in feelers
    )


def _held(feeler: Feeler, pitch_deg: float, middle_x: float) -> Array:
    x_m, y_m, _ = feeler.p_T_m
    turns = [pitch_deg if x_m >= middle_x else -pitch_deg, -ROLL_DEG if y_m > 0.0 else ROLL_DEG]
    return np.asarray(Rotation.from_euler("YX", turns, degrees=True).as_matrix())
