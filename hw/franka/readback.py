"""The arm's report of its load and its hand, against the sent values and the rig file.

Collision thresholds and joint impedance cannot be compared: no state of either SDK contains them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hw.franka.driver import SdkState
from hw.franka.settings import Payload
from hw.mass import Mass

LOAD_KG, LOAD_M, LOAD_KG_M2 = 0.001, 0.0005, 1e-5
"""The load that is read back may differ by this from the one that was sent, because states come in single precision."""
HAND_KG, HAND_M, HAND_KG_M2 = 0.05, 0.01, 0.002
"""The hand is set in Desk by a person, perhaps with fingers of their own; 0.05 kg are at most 0.4 Nm on a joint."""


def load_mismatch(state: SdkState, sent: Payload) -> str:
    """The difference between the load that the arm reports and the one that it was sent, in words, or ""."""
    body = Mass(sent.mass_kg, sent.com_F_m, sent.inertia_F_kg_m2)
    reported = (state.m_load, state.F_x_Cload, state.I_load)
    apart = _apart(reported, body, (LOAD_KG, LOAD_M, LOAD_KG_M2))
    return apart and f"the arm reports another load than it was sent: {apart}; recover; if this stays, restart the arm"


def hand_mismatch(state: SdkState, hand: Mass) -> str:
    """The difference between the end effector that is set in Desk and the hand that every check assumes, in words, or
    "".
    """
    apart = _apart((state.m_ee, state.F_x_Cee, state.I_ee), hand, (HAND_KG, HAND_M, HAND_KG_M2))
    return apart and f"the end effector that is set in Desk is not the hand: {apart}; set the hand there, then recover"


def _apart(reported: tuple[float, Sequence[float], Sequence[float]], body: Mass, most: tuple[float, ...]) -> str:
    mass_kg, com_m, inertia_kg_m2 = reported
    values = (
        ("mass", np.array([mass_kg]), np.array([body.kg]), "kg"),
        ("centre of mass", np.array(com_m)[:3], body.com_m, "m"),
        ("inertia", np.array(inertia_kg_m2), body.inertia_kg_m2.ravel(order="F"), "kg m²"),
    )
    for (name, got, expected, unit), limit in zip(values, most, strict=True):
        if not np.abs(got - expected).max() <= limit:
            return f"{name} {_listed(got)} {unit}, expected {_listed(expected)} {unit} (at most {limit:g} {unit} apart)"
    return ""


def _listed(values: np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in values.tolist())
