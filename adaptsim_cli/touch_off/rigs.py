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
from hw.collision import camera_box

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
    from sim.lab.simulated import READY_RAD, SimulatedLab
    from sim.lab.touch import TouchLab
    from sim.lab.world import load_world
    from sim.tasks import get_task

    task = get_task(config.task)
    world = load_world(config.world, task)
    known = current_calibration(config, places)
    zeros_rad = np.zeros(7) if known is None else known.offsets_rad()
    X_BC = SimulatedLab(task, world, config.seed).nominal_calibration().X_BC if known is None else np.array(known.X_AC)
    keep_out = (camera_box(X_BC),)
    with TouchLab(task, world, config.seed, home_q_rad=READY_RAD - zeros_rad, keep_out=keep_out) as lab:
        yield touch_rig(
            name="fake",
            title=f"simulated lab, world {world.name}",
            key=calibration_key(config),
            arm=lab.arm,
            hand=lab.hand,
            task=task,
            grasp=grasp,
            zeros_rad=zeros_rad,
            keep_out=keep_out,
            tool_there=lab.offer_tool,
        )
