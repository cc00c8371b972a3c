"""Whether two programs simulate the same scene."""

from __future__ import annotations

import hashlib

import numpy as np

from sim.tasks.fingerprint import fingerprint
from sim.tasks.task import Task

_PROBE = 0.4
"""Where in every range the probe lies."""


def scene_key(task: Task) -> str:
    """Sixteen hexadecimal digits that change with the task's interface or with its physics.

    One rollout stands for the physics: contact makes it feel any change of mesh, mass, step or contact law.
    """
    parameters, action, nuisance = (
        space.denormalise(np.full(len(space), _PROBE)) for space in (task.parameters, task.action, task.nuisance)
    )
    track = task.simulate(parameters, task.reference_context, action, nuisance)
    seen = np.round(track.at(task.observation.times_s), 6).tobytes()
    return hashlib.sha256(fingerprint(task).encode() + seen).hexdigest()[:16]
