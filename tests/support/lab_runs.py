"""Whole trials of the slider in the simulated lab."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from slider import HARDWARE, HOME_RAD, Unmodelled

from hw.joint_limits import LIMITS
from hw.types import Array, Execution, Frame, JointPath
from sim.lab.simulated import SimulatedLab
from sim.lab.world import Faults, Sensing, World
from sim.panda.model import inverse
from sim.panda.moves import move_path
from sim.panda.tool import cell_as_shipped

CELL = cell_as_shipped(HARDWARE, "panda")
XY_M = np.array([0.55, 0.0])


def world(sensing: Sensing | None = None, faults: Faults | None = None) -> World:
    return World(
        name="test",
        task="slider",
        description="",
        parameters=np.array([0.3, 1e5, 1, 2.0, 0.0]),
        nuisance=np.array([0.015]),
        unmodelled=Unmodelled(),
        sensing=sensing or Sensing(camera="small"),
        faults=faults or Faults(),
    )


def shove(xy_m: Array = XY_M) -> JointPath:
    motion = HARDWARE.plan(xy_m, np.array([0.08]))
    X_BF = motion.X_BT @ np.linalg.inv(HARDWARE.X_FT)
    return JointPath(motion.t_s, inverse(X_BF, np.zeros(len(motion.t_s)))[:, 0])


@dataclass(frozen=True)
class Trial:
    frames: tuple[Frame, ...]
    execution: Execution
    bytes_: bytes


def run(lab: SimulatedLab, trial: int, attempt: int = 0) -> Trial:
    """One whole trial, as a session does it."""
    path = shove()
    lab.bench.place(XY_M, trial, attempt)
    lab.arm.execute(move_path(HOME_RAD, path.q_rad[0], LIMITS["panda"]))
    lab.camera.start_recording()
    execution = lab.arm.execute(path)
    frames = tuple(lab.camera.stop_recording())
    images = b"".join(repr(f.t_s).encode() + f.colour.tobytes() + f.depth_mm.tobytes() for f in frames)
    return Trial(frames, execution, images + execution.q_measured_rad.tobytes() + repr(execution.t_start_s).encode())
