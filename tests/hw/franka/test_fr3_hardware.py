"""On a real FR3: `ADAPTSIM_TEST_FR3=172.16.0.2 pytest -m hardware tests/hw/franka/test_fr3_hardware.py`.

Before it: joints unlocked, FCI active, a real-time kernel (docs/guide/arms.md), the hand empty, closed and pointing
down, its fingertips at least 60 mm over the table, nobody in reach, a hand at the stop button. The arm moves down by
15 mm at 10 mm/s and back up. ADAPTSIM_TEST_PEDAL names the serial port of an enabling pedal, which is then held
throughout.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest
from cells import cell

from hw.errors import NoContact
from hw.franka.arm import FrankaArm, open_franka
from hw.franka.settings import FrankaSettings
from hw.kinematics import forward
from hw.serial.enable_pedal import EnablePedal
from hw.wrist import FINGERTIP_M
from sim.panda.tool import FINGERTIPS, empty_hand
from sim.panda.touching import HeldTool, Stage, descent

pytestmark = pytest.mark.hardware
WAY_M, SPEED_M_S, FORCE_N = 0.015, 0.010, 4.0
ROOM_M = 0.06
BENCH = HeldTool(cell("fr3", empty_hand()), np.eye(4))


@pytest.fixture
def arm() -> Iterator[FrankaArm]:
    address, port = os.environ.get("ADAPTSIM_TEST_FR3"), os.environ.get("ADAPTSIM_TEST_PEDAL")
    if not address:
        pytest.fail("say where the arm is: ADAPTSIM_TEST_FR3=172.16.0.2")
    with ExitStack() as stack:
        pedal = stack.enter_context(EnablePedal(port)) if port else None
        yield stack.enter_context(open_franka(BENCH.cell, FrankaSettings(address), pedal=pedal))


def test_it_reports_where_it_is_at_rest(arm: FrankaArm) -> None:
    states = [arm.state() for _ in range(100)]
    assert states[0].fault is None
    q_rad = np.array([state.q_rad for state in states])
    assert np.ptp(q_rad, axis=0).max() < 1e-3
    assert max(float(np.abs(state.dq_rad_s).max()) for state in states) < 0.02


def test_a_guarded_motion_in_free_air_ends_in_no_contact(arm: FrankaArm) -> None:
    before = arm.state()
    X_BF = forward(before.q_rad)
    tip_m = X_BF[:3, :3] @ [0.0, 0.0, FINGERTIP_M] + X_BF[:3, 3]
    assert tip_m[2] > ROOM_M, f"the fingertips are {1e3 * tip_m[2]:.0f} mm over z = 0: guide the arm up first"
    assert X_BF[2, 2] < -0.98, "the hand must point straight down: guide it there first"
    guard = BENCH.guard(FINGERTIPS, FORCE_N)
    path = descent(before.q_rad, (Stage(WAY_M, SPEED_M_S),), guard, 0.0, BENCH.cell.arm)
    with pytest.raises(NoContact, match="nothing"):
        arm.execute_until_contact(path, guard)
    after = arm.state()
    assert after.fault is None
    np.testing.assert_allclose(after.q_rad, before.q_rad, atol=1e-3)
    assert arm.last_execution is not None
    assert arm.last_execution.control_success_rate > 0.95
    off_rad = np.abs(arm.last_execution.q_measured_rad - arm.last_execution.q_commanded_rad)
    assert off_rad.max() < 0.01
