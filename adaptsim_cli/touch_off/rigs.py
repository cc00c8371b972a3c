"""Joins the real parts of a touch-off."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from adaptsim_cli.config import Config, Places
from adaptsim_cli.touch_off.joining import touch_rig
from adaptsim_cli.touch_off.parts import Grasp, TouchRig
from adaptsim_cli.touch_off.real import open_real_touch_rig
from adaptsim_cli.wiring_calibration import calibration_key, current_calibration
from hw.collision import LEVEL, camera_box
from hw.workcell import STOPS_AT_N, Workcell, arm_model

__all__ = ["open_touch_rig", "touch_rig"]


@contextmanager
def open_touch_rig(config: Config, places: Places, grasp: Grasp) -> Iterator[TouchRig]:
    """Arm and hand, connected. Nothing moves.

    Raises SimError, DeviceUnavailable, SessionError; for a real lab also UsageError and CalibrationMissing.
    """
    opened = _lab(config, places, grasp) if config.hw == "fake" else open_real_touch_rig(config, places, grasp)
    with opened as rig:
        yield rig


@contextmanager
def _lab(config: Config, places: Places, grasp: Grasp) -> Iterator[TouchRig]:
    from sim.lab.calibration import nominal_of
    from sim.lab.simulated import READY_RAD
    from sim.lab.touch import TouchLab
    from sim.lab.world import load_world
    from sim.panda.feelers import empty_hand, feeling
    from sim.tasks import get_task

    task = get_task(config.task)
    world = load_world(config.world, task)
    known = current_calibration(config, places)
    zeros_rad = np.zeros(7) if known is None else known.offsets_rad()
    X_BC = nominal_of(world, config.seed).X_BC if known is None else np.array(known.X_AC)
    cell = Workcell(arm_model("panda", zeros_rad), empty_hand(), LEVEL, (camera_box(X_BC),), STOPS_AT_N)
    with TouchLab(task, world, config.seed, cell, home_q_rad=cell.arm.reported_rad(READY_RAD)) as lab:
        yield touch_rig(
            name="fake",
            title=f"simulated lab, world {world.name}",
            key=calibration_key(config),
            arm=lab.arm,
            hand=lab.hand,
            task=task,
            grasp=grasp,
            cell=cell,
            loaded=feeling(task, task.X_FT),
            tool_there=lab.offer_tool,
        )
