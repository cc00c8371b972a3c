"""The parts of one session; `wiring` makes them, tests bring their own."""

from __future__ import annotations

from dataclasses import dataclass

from adaptsim_cli.session.policy import SessionLearner
from adaptsim_cli.session.target import Target
from sim.tasks.task import Task


@dataclass(frozen=True)
class Provenance:
    """Where the parts come from, for the record; never the hidden parameters of a world."""

    checkpoint: str
    checkpoint_sha256: str
    world_sha256: str  # "": real hardware
    calibration: str  # "": no camera
    calibration_sha256: str
    versions: dict[str, str]
    camera_late_s: float = 0.0  # subtracted from the camera's time stamps


@dataclass(frozen=True)
class Parts:
    """Task, target and learner of one session, with their provenance."""

    task: Task
    target: Target
    learner: SessionLearner
    provenance: Provenance
