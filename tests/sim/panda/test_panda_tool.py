"""What the tools of the tasks weigh, the hand included."""

from __future__ import annotations

import numpy as np
import pytest

from hw.collision import HAND_MASS
from sim.panda.tool import cell_as_shipped, tool_of
from sim.tasks import get_task


@pytest.mark.parametrize(("name", "tool_kg"), [("scooping", 0.12), ("pushing", 0.1)])
def test_hand_and_tool_weigh_what_their_sources_say(name: str, tool_kg: float) -> None:
    task = get_task(name)
    hardware = task.require_hardware()
    mass = tool_of(hardware).mass
    assert mass.kg == pytest.approx(HAND_MASS.kg + tool_kg)
    assert cell_as_shipped(hardware, "fr3").tool.mass.kg == mass.kg
    between = hardware.X_FT[:3, :3] @ hardware.tool_mass.com_m + hardware.X_FT[:3, 3]
    np.testing.assert_allclose(mass.com_m, (HAND_MASS.kg * HAND_MASS.com_m + tool_kg * between) / mass.kg)
    assert 0.05 < np.linalg.norm(between) < 0.35, "beyond the hand, and within the tool's reach"
    a, b, c = np.sort(np.linalg.eigvalsh(mass.inertia_kg_m2))
    assert a > 0.0
    assert c <= a + b, "no body is longer than that"
    assert c > np.linalg.eigvalsh(HAND_MASS.inertia_kg_m2).max()
