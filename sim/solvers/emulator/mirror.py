"""Every rollout a second time, mirrored: twice the data for nothing, in a task with a left-right symmetry."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from sim.rollouts.dataset import Dataset
from sim.tasks.task import Task


def with_mirror_images(task: Task, dataset: Dataset) -> Dataset:
    """The dataset, and after it all its rollouts mirrored, in the same order; the dataset itself if `Task.mirror` is
    None.

    Only for learning: row i + N mirrors row i, so denser rollouts do not come last any more.
    """
    mirror = task.mirror
    if mirror is None:
        return dataset
    observed = task.observation.denormalise(dataset.observation) * mirror.observed
    mirrored: dict[str, Any] = {
        "parameters": dataset.parameters * mirror.parameters,
        "action": dataset.action * mirror.action,
        "nuisance": dataset.nuisance * mirror.nuisance,
        "observation": task.observation.normalise(observed),
        "end_state": dataset.end_state * mirror.end_state,
    }
    both: dict[str, Any] = {}
    for field in fields(dataset):
        column = getattr(dataset, field.name)
        if isinstance(column, np.ndarray):
            both[field.name] = np.concatenate([column, mirrored.get(field.name, column)])
    return replace(dataset, **both)
