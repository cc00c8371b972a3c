"""The limits of ISO/TS 15066 beside what an arm would do."""

from __future__ import annotations

import pytest

from adaptsim_cli.bench.doctor.contact_limits import REGIONS, judged, struck_N
from hw.collision import HAND_MASS
from hw.dynamics import LINKS
from hw.mass import Mass

BY_NAME = {region.name: region for region in REGIONS}


def broken(speed_m_s: float, stops_at_N: float, edge_m: float) -> dict[str, tuple[str, ...]]:
    return {one.region.name: one.broken for one in judged("panda", speed_m_s, stops_at_N, HAND_MASS, edge_m)}


@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_a_hand_is_a_spring_between_two_masses(model: str):
    arm_kg = sum(link.kg for link in LINKS[model][1:]) / 2.0 + HAND_MASS.kg
    together_kg = 0.6 * arm_kg / (0.6 + arm_kg)
    energy_J = 0.5 * together_kg * 0.8**2
    assert struck_N(model, BY_NAME["hands and fingers"], 0.8, HAND_MASS) == pytest.approx(
        (2.0 * energy_J * 75e3) ** 0.5
    )
    heavier = HAND_MASS + Mass(2.0, HAND_MASS.com_m, HAND_MASS.inertia_kg_m2)
    assert struck_N(model, BY_NAME["chest"], 0.8, heavier) > struck_N(model, BY_NAME["chest"], 0.8, HAND_MASS)


def test_a_blade_at_full_speed_fails_on_pressure_everywhere_and_a_slow_blunt_tool_nowhere_but_on_the_head():
    blade = broken(0.8, 80.0, 0.0012)
    assert all("pressure, clamped" in limits for limits in blade.values())
    assert "pressure, struck" in blade["hands and fingers"]
    blunt = broken(0.1, 20.0, 0.03)
    assert {name for name, limits in blunt.items() if limits} == {"skull and forehead", "face"}
    assert blunt["face"] == ("any blow",), "no blow on skull or face is allowed, however gentle"


def test_force_alone_fails_where_an_arm_stops_too_late():
    assert "force, clamped" in broken(0.1, 120.0, 0.03)["abdomen"]
    assert "force, clamped" not in broken(0.1, 109.0, 0.03)["abdomen"]
    assert "force, struck" in broken(1.5, 20.0, 0.03)["chest"]
