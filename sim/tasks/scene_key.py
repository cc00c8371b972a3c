"""A key that is equal for two programs that simulate the same scene."""

from __future__ import annotations

import hashlib

import numpy as np

from sim.tasks.fingerprint import fingerprint
from sim.tasks.task import Task

_PROBES = 8
"""Number of rollouts spread over all ranges, the first of a Sobol sequence. Half a second for a contact task."""


def scene_key(task: Task) -> str:
    """Sixteen hexadecimal digits that change with the task's interface, its physics, or its rule for the end of a
    rollout.

    A few rollouts represent the physics. Contact makes them sensitive to any change of mesh, mass, step or contact law,
    and their ends to any change of the final judgement.
    """
    from scipy.stats import qmc  # noqa: PLC0415 - slow to import, and most commands ask for no key

    spaces = task.parameters, task.action, task.nuisance
    unit = qmc.Sobol(sum(map(len, spaces)), scramble=True, seed=0).random(_PROBES)
    parts = np.split(unit, np.cumsum([len(space) for space in spaces])[:-1], axis=1)
    total = hashlib.sha256(fingerprint(task).encode())
    for rows in zip(*(space.denormalise(part) for space, part in zip(spaces, parts, strict=True)), strict=True):
        parameters, action, nuisance = rows
        track = task.simulate(parameters, task.reference_context, action, nuisance)
        seen = np.concatenate([track.at(task.observation.times_s), track.state[-1:]])
        total.update(np.round(seen, 6).tobytes() + track.outcome.value.encode())
    return total.hexdigest()[:16]
