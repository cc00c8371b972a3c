"""The assumed poses of camera, table and tool: from the calibration and touch-off in use, or from all that are kept."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from adaptsim_cli.bench.calibration_in_use import calibration_of, calibrations
from adaptsim_cli.bench.devices.lab import Lab
from adaptsim_cli.bench.devices.mounted import MountedTask, mounted_task_of
from adaptsim_cli.bench.touch_off.store import SavedTouchOff
from adaptsim_cli.bench.touch_off_in_use import ZEROS_RAD, correction_by, serving, touch_off_of
from adaptsim_cli.config import Config, Places
from calib.types import HandEye
from hw.types import Array
from sim.tasks.task import Task


@dataclass(frozen=True, eq=False)
class RigFrames:
    """The poses with which trials are planned and tracked."""

    eye: HandEye  # over the table: in frame W
    mounted_task: MountedTask
    touched: SavedTouchOff | None

    @property
    def sha256(self) -> str:
        """SHA-256 of the poses of camera and tool, which a session records."""
        return hash_of(self.eye.X_BC, self.mounted_task.hardware.X_FT)


def hash_of(X_BC: Array, X_FT: Array) -> str:
    """SHA-256 of the camera's pose over the table and of the tool's pose at the flange, (4, 4) each."""
    return hashlib.sha256(np.ascontiguousarray(np.stack([X_BC, X_FT])).tobytes()).hexdigest()


def ground_of(config: Config, places: Places, task: Task, lab: Lab) -> RigFrames:
    """The poses in use now. Raises the errors of `calibration_of`, `touch_off_of` and `mounted_task_of`."""
    eye, zeros_rad = calibration_of(config, places, lab.nominal)
    return _ground(task, lab, eye, zeros_rad, touch_off_of(config, places, task, zeros_rad))


def _ground(task: Task, lab: Lab, eye: HandEye, zeros_rad: Array, touched: SavedTouchOff | None) -> RigFrames:
    correction = None if touched is None else correction_by(touched, lab.rig, task)
    mounted_task = mounted_task_of(task, lab.rig, zeros_rad, lab.boxes_around_camera(eye.X_BC), correction)
    return RigFrames(replace(eye, X_BC=mounted_task.correction.X_WB @ eye.X_BC), mounted_task, touched)


def every_ground(config: Config, places: Places, task: Task, lab: Lab) -> Iterator[RigFrames]:
    """Every calibration, with each touch-off made with its joint zeros and without any; newest first."""
    eyes: list[tuple[HandEye, Array]] = []
    store = calibrations(config, places)
    for path in reversed(store.numbered.all()):
        calibration = store.read(path)
        eyes.append((calibration.hand_eye(), calibration.offsets_rad()))
    if lab.nominal is not None:
        eyes.append((lab.nominal, np.zeros(7)))
    touches = [
        touching.read(path) for touching in serving(config, places, task) for path in reversed(touching.numbered.all())
    ]
    for eye, zeros_rad in eyes:
        for touched in (*touches, None):
            if touched is None or np.abs(zeros_rad - np.array(touched.joint_zeros_rad)).max() <= ZEROS_RAD:
                yield _ground(task, lab, eye, zeros_rad, touched)
