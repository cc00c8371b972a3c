"""The doctor's look at an arm, over the FR3's protocol: mode, joints, a second of states; nothing is set or moved."""

from __future__ import annotations

import numpy as np
import pytest
from fr3_process import READY_RAD, fr3, own_host

from hw.errors import DeviceUnavailable
from hw.franka.process import inspect
from hw.franka.settings import FrankaSettings


@pytest.mark.long
def test_mode_joints_and_states_are_read_and_nothing_is_set() -> None:
    with fr3(READY_RAD) as server:
        reading, rhythm, _ = inspect("fr3", FrankaSettings(server.host), realtime=False, states=200)
        assert reading.mode == "Idle"
        np.testing.assert_allclose(reading.q_rad, READY_RAD, atol=0.01)
        assert rhythm.states == 200
        assert rhythm.missed >= 0
        assert 0.0 < rhythm.longest_gap_s < 10.0
        assert server.configured() == []
        server.tell("press")
        stopped, _, _ = inspect("fr3", FrankaSettings(server.host), realtime=False, states=50)
        assert "the stop button is pressed" in str(stopped.unwilling)


def test_an_arm_that_is_not_there_is_said() -> None:
    with pytest.raises(DeviceUnavailable, match=r"answer|refuses"):
        inspect("fr3", FrankaSettings(own_host()), realtime=False)
