"""A camera whose stamps are late: what a calibration found of it is subtracted before frames and joints are paired."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from adaptsim_cli.bench.rig import Rig

from adaptsim_cli.bench.devices.mounted import mounted_as_shipped
from adaptsim_cli.bench.devices.trackers import tracker_of
from adaptsim_cli.session.rig_target import RigTarget
from calib.types import HandEye
from hw.types import Array
from perception.types import Outcome
from sim.adaptation.stages import TrialKey
from sim.lab.kinect import default_X_BC
from sim.lab.simulated import SimulatedLab
from sim.lab.world import Sensing, load_world
from sim.tasks import get_task

LATE_MS = 25.0
SLIDES_M_S = 0.2
KEY = TrialKey(1, 0)


class Nobody:
    """Is asked where the object lies, and does not mind."""

    def placed(self, what: str, wanted_m: Array, real: bool) -> None:
        return


def error_m(sensing: Sensing, believed_late_s: float) -> Array:
    """A gentle push in a lab: how far the track is from the truth at each frame while the bottle slides."""
    task = get_task("pushing")
    there = mounted_as_shipped(task, "panda")
    world = replace(load_world("wd", task), sensing=sensing)
    with SimulatedLab(task, world, 0, there.cell, home_q_rad=there.home_rad) as lab:
        eye = HandEye(default_X_BC(), 1.0, 0.1, "known", "", believed_late_s)
        rig = Rig("fake", "lab", lab.arm, lab.camera, lab.bench, eye)
        target = RigTarget(there.task, rig, tracker_of(there.task), there.planner())
        placed = target.place(task.reference_context, KEY, Nobody())  # type: ignore[arg-type]
        action = task.action.denormalise(np.array([0.5, 0.0]))
        motion = target.execute(target.plan(placed, action))
        motion.files()
        track = motion.track().track
        assert motion.recorded is not None
        began_s = motion.recorded.execution.t_start_s
        true = next(m for m in lab.truth()["trials"][-1]["motions"] if m["t_start_s"] == began_s)
    assert track.outcome is Outcome.UPRIGHT
    p_m, t_s = np.array(true["X_BO"])[:, :2, 3], np.array(true["t_s"])
    p_m, v_m_s = (
        np.stack([np.interp(track.t_s, t_s, column) for column in columns.T], axis=-1)
        for columns in (p_m, np.gradient(p_m, t_s, axis=0))
    )
    slides = np.linalg.norm(v_m_s, axis=1) > SLIDES_M_S
    return np.asarray(np.linalg.norm(track.state[:, :2] - p_m, axis=1)[slides])


@pytest.mark.slow
def test_a_late_camera_is_tracked_as_well_as_one_in_time():
    late = Sensing(camera="small", clock_offset_ms=LATE_MS)
    unaware_m, corrected_m = (error_m(late, late_s) for late_s in (0.0, 1e-3 * LATE_MS))
    assert len(corrected_m) > 5
    assert np.median(unaware_m) > 4e-3
    assert np.median(corrected_m) < 2e-3
