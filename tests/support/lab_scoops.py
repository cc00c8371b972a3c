"""Whole trials of one scoop in the simulated lab, of scooping's plainest world, seen by the small camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from hw.types import Array, Execution, Frame, JointPath
from sim.lab.simulated import READY_RAD, SimulatedLab
from sim.lab.world import Faults, Sensing, World, load_world
from sim.panda.planning import trial_paths
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()
CELL = cell_as_shipped(HARDWARE, "panda")
XY_M = TASK.reference_context


def world(sensing: Sensing | None = None, faults: Faults | None = None) -> World:
    return replace(load_world("wd", TASK), sensing=sensing or Sensing(camera="small"), faults=faults or Faults())


@cache
def scoop() -> tuple[JointPath, JointPath, JointPath]:
    """Approach from the ready pose, a gentle late scoop at `XY_M`, and retreat."""
    motion = HARDWARE.plan(XY_M, np.array([0.10, 0.05, 0.018]))
    return trial_paths(motion, HARDWARE.X_FT, CELL, READY_RAD, carries=HARDWARE.carries)


def resting() -> Array:
    """(4, 4) the piece as it lies at `XY_M`."""
    wd = world()
    return HARDWARE.rest_pose(XY_M, wd.parameters, wd.nuisance, wd.unmodelled)


@dataclass(frozen=True)
class Trial:
    frames: tuple[Frame, ...]
    execution: Execution
    bytes_: bytes


def run(lab: SimulatedLab, trial: int, attempt: int = 0) -> Trial:
    """One whole trial, as a session does it, without the way home."""
    approach, path, _ = scoop()
    lab.bench.place(XY_M, trial, attempt)
    lab.arm.execute(approach)
    lab.camera.start_recording()
    execution = lab.arm.execute(path)
    frames = tuple(lab.camera.stop_recording())
    images = b"".join(repr(f.t_s).encode() + f.colour.tobytes() + f.depth_mm.tobytes() for f in frames)
    return Trial(frames, execution, images + execution.q_measured_rad.tobytes() + repr(execution.t_start_s).encode())
