"""The properties that a stored dataset or checkpoint must share with its task."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np

from sim.tasks.task import Task
from sim.types import Space


def describe(space: Space) -> list[dict[str, Any]]:
    """The dimensions of a space as plain values, for a TOML file."""
    return [
        {"name": d.name, "unit": d.unit, "low": float(d.low), "high": float(d.high), "scale": d.scale}
        for d in space.dimensions
    ]


def interface(task: Task) -> dict[str, Any]:
    """Every property of a task that decides the meaning of the numbers in a dataset or a network."""
    seen = task.observation
    return {
        "task": task.name,
        "parameters": describe(task.parameters),
        "margin": describe(task.margin),
        "context": describe(task.context),
        "action": describe(task.action),
        "nuisance": describe(task.nuisance),
        "action_noise": np.asarray(task.action_noise, dtype=float).tolist(),
        "reference_context": np.asarray(task.reference_context, dtype=float).tolist(),
        "observation": {
            "times_s": np.asarray(seen.times_s, dtype=float).tolist(),
            "columns": list(seen.columns),
            "low": np.asarray(seen.low, dtype=float).tolist(),
            "high": np.asarray(seen.high, dtype=float).tolist(),
        },
    }


def fingerprint(task: Task) -> str:
    """Sixteen hexadecimal digits that change with any range, unit or observation time of the task."""
    return hashlib.sha256(json.dumps(interface(task), sort_keys=True).encode()).hexdigest()[:16]
