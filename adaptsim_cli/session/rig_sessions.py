"""The poses of the rig with which a stored session was begun, and the sessions that can continue with those in use."""

from __future__ import annotations

from adaptsim_cli.bench.calibration_in_use import calibration_key
from adaptsim_cli.bench.checkpoints import task_of
from adaptsim_cli.bench.devices.lab import Lab
from adaptsim_cli.bench.devices.opening import open_lab
from adaptsim_cli.bench.rig_frames import RigFrames, every_ground, ground_of
from adaptsim_cli.config import Config, Places
from adaptsim_cli.errors import CliError, UsageError
from adaptsim_cli.session import folders
from adaptsim_cli.session.records import SessionFacts
from adaptsim_cli.session.store import SessionStore
from calib.errors import CalibrationError
from sim.errors import SimError
from sim.tasks.task import Task


def own_ground(config: Config, places: Places, task: Task, lab: Lab, facts: SessionFacts) -> RigFrames:
    """The poses that a session was begun with, searched among all stored ones. Raises UsageError if they are gone."""
    grounds = (one for one in every_ground(config, places, task, lab) if one.sha256 == facts.calibration_sha256)
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
