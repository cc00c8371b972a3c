"""The limits of a person's body in a contact, beside the effect of this arm: ISO/TS 15066:2016, annex A.

The limits were not compared with the standard itself; the assessment says so.

Force and pressure are those of table A.2; a region has the lowest pressure of all its places. A contact that clamps
(quasi-static) may last; one from which the body can recoil (transient) may reach twice as much, but none is allowed on
skull and face. The force of a transient contact is that of a spring between two masses (A.3.2 and table A.3): F = v √(k
μ). These are limits of the onset of pain, not of injury; the lab compares them with the standard's own text.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.dynamics import LINKS
from hw.mass import Mass

FINGER_M = 0.010
"""The least length of an edge that a contact covers, about the width of a finger."""
_CM2_M2 = 1e4


@dataclass(frozen=True)
class BodyRegion:
    """One region of the body, with its limits for a contact that clamps."""

    name: str
    force_N: float
    pressure_N_cm2: float
    transient: float | None  # how many times more a transient contact may have; None: none is allowed
    mass_kg: float
    stiffness_N_m: float


REGIONS = (
    BodyRegion("skull and forehead", 130.0, 110.0, None, 4.4, 150e3),
    BodyRegion("face", 65.0, 110.0, None, 4.4, 75e3),
    BodyRegion("neck", 150.0, 140.0, 2.0, 1.2, 50e3),
    BodyRegion("back and shoulders", 210.0, 160.0, 2.0, 40.0, 35e3),
    BodyRegion("chest", 140.0, 120.0, 2.0, 40.0, 25e3),
    BodyRegion("abdomen", 110.0, 140.0, 2.0, 40.0, 10e3),
    BodyRegion("pelvis", 180.0, 210.0, 2.0, 40.0, 25e3),
    BodyRegion("upper arms and elbows", 150.0, 190.0, 2.0, 3.0, 30e3),
    BodyRegion("lower arms and wrists", 160.0, 180.0, 2.0, 2.0, 40e3),
    BodyRegion("hands and fingers", 140.0, 190.0, 2.0, 0.6, 75e3),
    BodyRegion("thighs and knees", 220.0, 220.0, 2.0, 75.0, 50e3),
    BodyRegion("lower legs", 130.0, 210.0, 2.0, 75.0, 60e3),
)


@dataclass(frozen=True)
class RegionVerdict:
    """The limits of one region beside the contact of this arm, clamping and transient."""

    region: BodyRegion
    clamped_N: float
    struck_N: float
    area_cm2: float

    @property
    def clamped_N_cm2(self) -> float:
        """The pressure of the edge at the force at which the arm stops by itself."""
        return self.clamped_N / self.area_cm2

    @property
    def struck_N_cm2(self) -> float:
        """The pressure of the edge in a transient contact."""
        return self.struck_N / self.area_cm2

    @property
    def broken(self) -> tuple[str, ...]:
        """The limits that this contact exceeds; empty: none."""
        region, times = self.region, self.region.transient
        checks = {
            "force, clamped": self.clamped_N > region.force_N,
            "pressure, clamped": self.clamped_N_cm2 > region.pressure_N_cm2,
            "any blow": times is None,
            "force, struck": times is not None and self.struck_N > times * region.force_N,
            "pressure, struck": times is not None and self.struck_N_cm2 > times * region.pressure_N_cm2,
        }
        return tuple(name for name, is_broken in checks.items() if is_broken)


def judged(model: str, speed_m_s: float, stops_at_N: float, load: Mass, edge_m: float) -> tuple[RegionVerdict, ...]:
    """Every region in contact with an edge of width `edge_m` that moves at `speed_m_s`, on an arm that stops by itself
    at `stops_at_N`.
    """
    area_cm2 = edge_m * max(edge_m, FINGER_M) * _CM2_M2
    return tuple(
        RegionVerdict(region, stops_at_N, struck_N(model, region, speed_m_s, load), area_cm2) for region in REGIONS
    )


def struck_N(model: str, region: BodyRegion, speed_m_s: float, load: Mass) -> float:
    """The peak force (N) of a transient contact of an arm at `speed_m_s`, with `load` (hand and tool) on the flange."""
    moving_kg = sum(link.kg for link in LINKS[model][1:])
    arm_kg = moving_kg / 2.0 + load.kg
    together_kg = 1.0 / (1.0 / region.mass_kg + 1.0 / arm_kg)
    return float(speed_m_s * np.sqrt(region.stiffness_N_m * together_kg))
