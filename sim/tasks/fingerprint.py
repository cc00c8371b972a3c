"""The properties that a stored dataset or checkpoint must share with its task, and the key of a simulated scene."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from sim.tasks.task import Task
from sim.types import Space


def describe(space: Space) -> list[dict[str, Any]]:
    """The dimensions of a space as plain values, for a TOML file."""
    return [
        {"name": d.name, "unit": d.unit, "low": float(d.low), "high": float(d.high), "scale": d.scale}
        | ({"words": list(d.words)} if d.words else {})
        for d in space.dimensions
    ]


def interface(task: Task) -> dict[str, Any]:
    """Every property of a task that decides the meaning of the numbers in a dataset or a network."""
    observation = task.observation
    effects = {} if task.scene is None else asdict(task.scene)
    scene = {"scene": {k: v for k, v in json.loads(json.dumps(effects)).items() if v is not None}} if effects else {}
    moved = {"context_moves": True} if len(task.physical_context) else {}
    credited = {"partial_credit": True} if task.reward_of_failure is not None else {}
    return (
        scene
        | moved
        | credited
        | {
            "task": task.name,
            "parameters": describe(task.parameters),
            "margin": describe(task.margin),
            "context": describe(task.context),
            "action": describe(task.action),
            "nuisance": describe(task.nuisance),
            "action_noise": np.asarray(task.action_noise, dtype=float).tolist(),
            "reference_context": np.asarray(task.reference_context, dtype=float).tolist(),
            "observation": {
                "times_s": np.asarray(observation.times_s, dtype=float).tolist(),
                "columns": list(observation.columns),
                "low": np.asarray(observation.low, dtype=float).tolist(),
                "high": np.asarray(observation.high, dtype=float).tolist(),
            },
        }
    )


def fingerprint(task: Task) -> str:
    """Sixteen hexadecimal digits that change with any range, unit or observation time of the task."""
    return hashlib.sha256(json.dumps(interface(task), sort_keys=True).encode()).hexdigest()[:16]


def content(task: Task) -> str:
    """Sixteen hexadecimal digits of the content of a task's file and of the files of its scenes; empty for a package's
    task.
    """
    if task.file is None:
        return ""
    total = hashlib.sha256(task.file.sha256.encode())
    for name in task.scene_files:
        path = Path(name)
        total.update(hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b"missing")
    return total.hexdigest()[:16]


def changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[str, ...]:
    """The differences of two interfaces, in words, the likeliest to matter first."""
    return tuple(sentence for key in now for sentence in _changes(key, before.get(key), now[key]))


def _changes(key: str, before: Any, now: Any) -> Iterator[str]:
    if before == now:
        return
    if not (isinstance(now, list) and isinstance(before, list) and all(isinstance(d, dict) for d in (*now, *before))):
        yield key
        return
    old, new = ({d["name"]: d for d in ones} for ones in (before, now))
    for name in [*old, *(n for n in new if n not in old)]:
        if name not in new:
            yield f"{key}: {name} is gone"
        elif name not in old:
            yield f"{key}: {name} is new"
        elif old[name] != new[name]:
            yield f"{key}: {name} was {_in_words(old[name])}, is {_in_words(new[name])}"
    if list(old) != list(new) and set(old) == set(new):
        yield f"{key}: another order"


def _in_words(dimension: Mapping[str, Any]) -> str:
    if words := dimension.get("words"):
        return ", ".join(words)
    return f"{dimension['low']:g} to {dimension['high']:g} {dimension['unit']}".rstrip()


_PROBES = 8
"""Number of rollouts spread over all ranges, the first of a Sobol sequence. Half a second for a contact task."""


def scene_key(task: Task, probes: int = _PROBES) -> str:
    """Sixteen hexadecimal digits that change with the task's interface, its physics, or its rule for the end of a
    rollout.

    A few rollouts represent the physics. Contact makes them sensitive to any change of mesh, mass, step or contact law,
    and their ends to any change of the final judgement.
    """
    from scipy.stats import qmc  # noqa: PLC0415 - slow to import, and most commands ask for no key

    spaces = task.parameters, task.action, task.nuisance, task.physical_context
    unit = qmc.Sobol(sum(map(len, spaces)), scramble=True, seed=0).random(probes)
    parts = np.split(unit, np.cumsum([len(space) for space in spaces])[:-1], axis=1)
    total = hashlib.sha256(fingerprint(task).encode())
    for rows in zip(*(space.denormalise(part) for space, part in zip(spaces, parts, strict=True)), strict=True):
        parameters, action, nuisance, drawn = rows
        context = drawn if len(task.physical_context) else task.reference_context
        track = task.simulate(parameters, context, action, nuisance)
        samples = np.concatenate([track.at(task.observation.times_s), track.state[-1:]])
        total.update(np.round(samples, 6).tobytes() + track.outcome.value.encode())
        if task.reward_of_failure is not None and not task.succeeded(track):
            total.update(np.round(task.failure_reward(track), 6).tobytes())
    return total.hexdigest()[:16]
