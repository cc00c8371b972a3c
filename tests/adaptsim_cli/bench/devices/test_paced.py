"""The simulated lab at the arm's own pace: waits for the rest of each motion, and for nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from cells import cell
from guarded_paths import GUARD, Q_TOP_RAD, TOOL, down

from adaptsim_cli import config
from adaptsim_cli.bench.devices.consent import SLOW_PACE
from adaptsim_cli.bench.devices.opening import open_lab
from adaptsim_cli.bench.devices.pacing import PacedArm, at_speed
from adaptsim_cli.errors import UsageError
from hw.braking import slowed
from hw.collision import Table
from hw.errors import ArmFault
from hw.fake import FakeArm, FakeClock
from hw.kinematics import forward
from hw.stopping import REDUCED_M_S, speeds_m_s
from hw.types import Contact, Execution, Guard, JointPath
from sim.panda.moves import move_path
from sim.tasks import get_task

CELL = cell(tool=TOOL)
STRETCHED = np.array([0.0, -0.1, 0.0, -1.4, 0.0, 1.9, np.pi / 4])
PATH = move_path(Q_TOP_RAD, Q_TOP_RAD + 0.2 * np.eye(7)[0], CELL.arm.limits, 0.3)


class SlowArm(FakeArm):
    """It takes a while to compute a motion."""

    computing_s, wall = 0.0, FakeClock()

    def execute(self, path: JointPath) -> Execution:
        self.wall.sleep(self.computing_s)
        return super().execute(path)


class FeelingArm(FakeArm):
    """Its way to the table and back takes 2.5 s."""

    def __init__(self) -> None:
        self.clock = FakeClock()
        super().__init__(Q_TOP_RAD, self.clock, CELL, plane=Table(0.0))

    def execute_until_contact(self, path: JointPath, guard: Guard) -> Contact:
        self.clock.sleep(2.5)
        return super().execute_until_contact(path, guard)


@pytest.mark.parametrize(("computing_s", "taken_s"), [(0.0, PATH.duration_s), (0.3, PATH.duration_s), (99.0, 99.0)])
def test_a_motion_takes_as_long_as_the_arm_or_as_computing_it(computing_s, taken_s):
    inner = SlowArm(Q_TOP_RAD, FakeClock(5.0), CELL)
    inner.wall, inner.computing_s = FakeClock(70.0), computing_s
    with PacedArm(inner, CELL, realtime=True, now_s=inner.wall.now_s, pause=inner.wall.sleep) as arm:
        played = arm.execute(PATH)
    assert played.t_start_s == 5.0  # on the arm's own clock
    assert inner.wall.now_s() == pytest.approx(70.0 + taken_s)


def test_a_motion_that_stops_takes_until_its_stop():
    wall = FakeClock()
    inner = FakeArm(Q_TOP_RAD, FakeClock(), CELL, faults={1: ArmFault("reflex")})
    with (
        PacedArm(inner, CELL, realtime=True, now_s=wall.now_s, pause=wall.sleep) as arm,
        pytest.raises(ArmFault, match="reflex"),
    ):
        arm.execute(PATH)
    assert wall.now_s() == pytest.approx(PATH.duration_s / 2, abs=0.002)


def test_a_touch_takes_its_way_there_and_back():
    wall = FakeClock()
    with PacedArm(FeelingArm(), CELL, realtime=True, now_s=wall.now_s, pause=wall.sleep) as arm:
        assert arm.execute_until_contact(down(), GUARD).t_s > 0.0
    assert wall.now_s() == 2.5


@pytest.mark.parametrize("realtime", [False, True])
def test_only_who_asks_for_it_waits(realtime):
    wall = FakeClock()
    inner = FakeArm(Q_TOP_RAD, FakeClock(), CELL)
    with PacedArm(inner, CELL, 0.5, realtime=realtime, now_s=wall.now_s, pause=wall.sleep) as arm:
        played = arm.execute(PATH)
    assert played.t_s[-1] == pytest.approx(2.0 * PATH.duration_s, abs=0.002), "at half the pace"
    assert wall.now_s() == pytest.approx(played.t_s[-1] if realtime else 0.0, abs=0.002)


def test_the_slow_pace_of_first_motions_keeps_every_point_under_250_mm_s():
    """A ratio alone does not: 0.3 of a fast motion is still fast."""
    fast = move_path(STRETCHED, STRETCHED + 1.2 * np.eye(7)[0], CELL.arm.limits, 0.9)
    arm = PacedArm(FakeArm(STRETCHED, FakeClock(), CELL), CELL, SLOW_PACE)
    assert speeds_m_s(slowed(fast, SLOW_PACE), CELL).max() > 1.05 * REDUCED_M_S
    with arm:
        played = arm.execute(fast)
    tool = forward(played.q_commanded_rad) @ np.concatenate([TOOL.points_F_m[0], [1.0]])
    assert 0.2 < np.linalg.norm(np.diff(tool[:, :3], axis=0), axis=1).max() * 1e3 < REDUCED_M_S
    assert speeds_m_s(JointPath(played.t_s, played.q_commanded_rad), CELL).max() < REDUCED_M_S
    assert at_speed(fast, 0.31, CELL).duration_s == pytest.approx(fast.duration_s / 0.31, abs=0.002), "only a ratio"
    with pytest.raises(ValueError, match="pace"):
        at_speed(fast, 0.05, CELL)


def test_a_real_arm_keeps_its_own_pace(refused):
    real = config.load().config.model_copy(update={"hw": "fr3", "realtime": True})
    said = r"--realtime slows the simulated lab down, but this is a real arm \(fr3\)"
    with pytest.raises(UsageError, match=said), open_lab(real, get_task("scooping")):
        pass
    assert "--realtime" in refused(2, "rollout", "--hw", "fr3", "--realtime")
