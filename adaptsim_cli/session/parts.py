"""All that one session is joined from; `wiring` makes it, tests bring their own."""

from __future__ import annotations

from dataclasses import dataclass

from adaptsim_cli.session.policy import SessionLearner
from adaptsim_cli.session.target import Target
from sim.tasks.task import Task


@dataclass(frozen=True)
class Provenance:
    """Where the parts come from, for the record; never what is hidden in a world."""

    checkpoint: str
    checkpoint_sha256: str
    world_sha256: str  # "" where the hardware is real
    calibration: str  # "" where there is no camera
    calibration_sha256: str
    versions: dict[str, str]
    camera_late_s: float = 0.0  # subtracted from the camera's time stamps


@dataclass(frozen=True)
class Parts:
    """Everything that one session is joined from."""

    task: Task
    target: Target
    learner: SessionLearner
    provenance: Provenance
