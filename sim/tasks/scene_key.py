"""Whether two programs simulate the same scene."""

from __future__ import annotations

import hashlib

import numpy as np
from scipy.stats import qmc

from sim.tasks.fingerprint import fingerprint
from sim.tasks.task import Task

_PROBES = 8
"""Rollouts spread over all ranges: the first of a Sobol sequence. Half a second for a contact task."""


def scene_key(task: Task) -> str:
    """Sixteen hexadecimal digits that change with the task's interface, its physics, or with when a rollout is over.

    A few rollouts stand for the physics: contact makes them feel any change of mesh, mass, step or contact law, and
    their ends any change of what is judged.
    """
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
