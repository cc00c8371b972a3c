"""Faults of a world: each comes at its trial, once, and leaves a lab in which the trial can be redone."""

from __future__ import annotations

import numpy as np
import pytest
from slider import CELL, HOME_RAD, TASK, XY_M, run, shove, world

from hw.errors import ArmFault, CameraError, StoppedByPedal
from hw.joint_limits import LIMITS
from hw.types import JointPath
from sim.lab.simulated import SimulatedLab
from sim.lab.world import Faults, Sensing
from sim.panda.moves import move_path


def lab_with(**faults: tuple[int, ...]) -> SimulatedLab:
    return SimulatedLab(TASK, world(Sensing(camera="small"), Faults(**faults)), 3, CELL)


def until_task(lab: SimulatedLab, trial: int, attempt: int = 0) -> JointPath:
    path = shove()
    lab.bench.place(XY_M, trial, attempt)
    lab.arm.execute(move_path(HOME_RAD, path.q_rad[0], LIMITS["panda"]))
    return path


def test_a_reflex_stops_the_task_path_of_its_trial() -> None:
    with lab_with(arm_reflex=(2,)) as lab:
        lab.arm.execute(until_task(lab, 1))
        path = until_task(lab, 2)
        with pytest.raises(ArmFault, match=r"reflex .* recover it") as caught:
            lab.arm.execute(path)
        assert not isinstance(caught.value, StoppedByPedal)
        q_rad = lab.arm.state().q_rad
        reached = np.abs(path.q_rad - q_rad).max(axis=1).argmin() / (len(path.t_s) - 1)
        assert 0.25 < reached < 0.65
        lab.arm.recover()
        lab.arm.execute(move_path(q_rad, HOME_RAD, LIMITS["panda"]))


def test_releasing_the_pedal_brakes_along_the_path() -> None:
    with lab_with(pedal_release=(1,)) as lab:
        path = until_task(lab, 1)
        lab.camera.start_recording()
        with pytest.raises(StoppedByPedal, match="pedal was released"):
            lab.arm.execute(path)
        off = np.abs(path.q_rad - lab.arm.state().q_rad).max(axis=1)
        assert off.min() < 1e-3  # on the path
        assert 0.25 < off.argmin() / (len(path.t_s) - 1) < 0.8
        assert len(lab.camera.stop_recording()) > 10


@pytest.mark.long
def test_the_camera_times_out_once_and_the_redo_is_well() -> None:
    with lab_with(camera_timeout=(1,)) as lab:
        with pytest.raises(CameraError, match="no frame within 1 s"):
            run(lab, 1)
        assert len(run(lab, 1, attempt=1).frames) > 30
        assert len(run(lab, 2).frames) > 30


def test_a_fault_is_the_same_after_a_restart() -> None:
    ends = []
    for _ in range(2):
        with lab_with(arm_reflex=(2,)) as lab:
            path = until_task(lab, 2)
            with pytest.raises(ArmFault):
                lab.arm.execute(path)
            ends.append(lab.arm.state().q_rad)
    np.testing.assert_array_equal(ends[0], ends[1])


@pytest.mark.long
def test_placing_the_object_anew_finds_the_arm_at_home() -> None:
    with lab_with(arm_reflex=(1,)) as lab:
        with pytest.raises(ArmFault):
            lab.arm.execute(until_task(lab, 1))
        lab.arm.recover()
        lab.bench.place(XY_M, 1, 1)
        np.testing.assert_array_equal(lab.arm.state().q_rad, HOME_RAD)
        with lab_with() as afresh:
            assert run(lab, 1, 1).bytes_ == run(afresh, 1, 1).bytes_
