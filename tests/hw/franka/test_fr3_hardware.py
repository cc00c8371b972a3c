"""On a real FR3: `ADAPTSIM_TEST_FR3=172.16.0.2 pytest -m hardware tests/hw/franka/test_fr3_hardware.py`.

Before it: joints unlocked, FCI active, a real-time kernel (docs/guide/arms.md), the hand empty, closed and pointing
down, its fingertips at least 60 mm over the table, nobody in reach, a hand at the stop button. The arm turns its
last joint by 3° and back. ADAPTSIM_TEST_PEDAL names the serial port of an enabling pedal, which is then held
throughout.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest
from cells import cell
from fingertip_paths import TOOL

from hw.franka.arm import FrankaArm, open_franka
from hw.franka.settings import FrankaSettings
from hw.kinematics import forward
from hw.serial.enable_pedal import EnablePedal
from hw.wrist import FINGERTIP_M
from sim.panda.moves import move_path

pytestmark = pytest.mark.hardware
TURN_RAD = 0.05
ROOM_M = 0.06
CELL = cell("fr3", TOOL)


@pytest.fixture
def arm() -> Iterator[FrankaArm]:
    address, port = os.environ.get("ADAPTSIM_TEST_FR3"), os.environ.get("ADAPTSIM_TEST_PEDAL")
    if not address:
        pytest.fail("say where the arm is: ADAPTSIM_TEST_FR3=172.16.0.2")
    with ExitStack() as stack:
        pedal = stack.enter_context(EnablePedal(port)) if port else None
        yield stack.enter_context(open_franka(CELL, FrankaSettings(address), pedal=pedal))


def test_it_reports_where_it_is_at_rest(arm: FrankaArm) -> None:
    states = [arm.state() for _ in range(100)]
    assert states[0].fault is None
    q_rad = np.array([state.q_rad for state in states])
    assert np.ptp(q_rad, axis=0).max() < 1e-3
    assert max(float(np.abs(state.dq_rad_s).max()) for state in states) < 0.02


def test_a_slow_turn_of_the_last_joint_there_and_back(arm: FrankaArm) -> None:
    before = arm.state()
    X_BF = forward(before.q_rad)
    tip_m = X_BF[:3, :3] @ [0.0, 0.0, FINGERTIP_M] + X_BF[:3, 3]
    assert tip_m[2] > ROOM_M, f"the fingertips are {1e3 * tip_m[2]:.0f} mm over z = 0: guide the arm up first"
    assert X_BF[2, 2] < -0.98, "the hand must point straight down: guide it there first"
    turned_rad = before.q_rad + TURN_RAD * np.eye(7)[6]
    for start_rad, end_rad in ((before.q_rad, turned_rad), (turned_rad, before.q_rad)):
        played = arm.execute(move_path(start_rad, end_rad, CELL.arm.limits, 0.05))
        assert played.control_success_rate > 0.95
        assert np.abs(played.q_measured_rad - played.q_commanded_rad).max() < 0.01
    after = arm.state()
    assert after.fault is None
    np.testing.assert_allclose(after.q_rad, before.q_rad, atol=1e-3)
