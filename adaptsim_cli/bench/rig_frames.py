"""The assumed poses of camera, table and tool: from the calibration and touch-off in use, or those of a session."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from adaptsim_cli.bench.calibration_in_use import calibration_key, calibration_of, calibrations
from adaptsim_cli.bench.checkpoints import task_of
from adaptsim_cli.bench.devices.lab import Lab
from adaptsim_cli.bench.devices.mounted import MountedTask, mounted
from adaptsim_cli.bench.devices.opening import open_lab
from adaptsim_cli.bench.touch_off.store import SavedTouchOff
from adaptsim_cli.bench.touch_off_in_use import ZEROS_RAD, correction_by, serving, touch_off_of
from adaptsim_cli.config import Config, Places
from adaptsim_cli.errors import CliError, UsageError
from adaptsim_cli.session import folders
from adaptsim_cli.session.records import Facts
from adaptsim_cli.session.store import SessionStore
from calib.errors import CalibrationError
from calib.types import HandEye
from hw.types import Array
from sim.errors import SimError
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
    """The poses in use now. Raises the errors of `calibration_of`, `touch_off_of` and `mounted`."""
    eye, zeros_rad = calibration_of(config, places, lab.nominal)
    return _ground(task, lab, eye, zeros_rad, touch_off_of(config, places, task, zeros_rad))


def own_ground(config: Config, places: Places, task: Task, lab: Lab, facts: Facts) -> RigFrames:
    """The poses that a session was begun with, searched among all stored ones. Raises UsageError if they are gone."""
    grounds = (one for one in _kept(config, places, task, lab) if one.sha256 == facts.calibration_sha256)
    ground = next((one for one in grounds if one.eye.camera_late_s == facts.camera_late_s), None)
    if ground is None:
        raise UsageError(
            f"session {facts.name!r} was begun with a calibration or touch-off that is no longer kept; name another "
            "--session"
        )
    return ground


def open_sessions(config: Config, places: Places) -> tuple[str, ...]:
    """The sessions of this rig that can continue now, but not after its calibration or touch-off is replaced."""
    rig, now = calibration_key(config), dict[tuple[str, str], str]()
    names = []
    for name in folders.names(places.sessions):
        try:
            facts = SessionStore.open(places.sessions, name).facts
            identity = {"task": facts.task, "object": facts.object, "seed": facts.seed}
            settings = config.model_copy(update={**identity, "world": facts.world or config.world})
            if facts.hw != config.hw or not facts.calibration or calibration_key(settings) != rig:
                continue
            key = facts.task, facts.object
            if key not in now:
                task = task_of(settings)
                with open_lab(settings, task) as lab:
                    now[key] = ground_of(settings, places, task, lab).sha256
        except (CliError, SimError, CalibrationError, OSError):  # damaged, or its world is gone: not open
            continue
        if facts.calibration_sha256 == now[key]:
            names.append(name)
    return tuple(names)


def _ground(task: Task, lab: Lab, eye: HandEye, zeros_rad: Array, touched: SavedTouchOff | None) -> RigFrames:
    correction = None if touched is None else correction_by(touched, lab.rig, task)
    mounted_task = mounted(task, lab.rig, zeros_rad, lab.boxes_around_camera(eye.X_BC), correction)
    return RigFrames(replace(eye, X_BC=mounted_task.correction.X_WB @ eye.X_BC), mounted_task, touched)


def _kept(config: Config, places: Places, task: Task, lab: Lab) -> Iterator[RigFrames]:
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
