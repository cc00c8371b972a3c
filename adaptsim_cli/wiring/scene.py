"""The adapted scene of a session, with one trial of its best policy, as files for other simulators."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsim_cli.session.store import SessionStore, trials_of
from adaptsim_cli.wiring.best import policy_of_session
from adaptsim_cli.wiring.hindsight import Hindsight

if TYPE_CHECKING:
    from sim.types import Space

INTERVAL = (0.05, 0.95)
"""Levels between which the stated share of the posterior lies."""


def files_of(store: SessionStore, kind: str) -> dict[str, bytes]:
    """Name -> content of the scene as `sdf` or `mjcf`, at the posterior mean; the context is that of the newest trial.

    Raises NoHardware for a task without a scene, SessionError before the first complete iteration, CheckpointError,
    OutOfRange, ExtraMissing.
    """
    from sim.lab.scene_files import PlannedTrial, as_mjcf, as_sdf

    hindsight = Hindsight.of(store)
    task = hindsight.checkpoint.solver.task
    task.require_hardware()
    known = hindsight.posterior(store)
    low, high = known.quantiles(INTERVAL)
    context = trials_of(store)[-1].context_array
    action = policy_of_session(store, hindsight.checkpoint)(context)
    trial = PlannedTrial(task, known.mean, context, action)
    share = round(100 * (INTERVAL[1] - INTERVAL[0]))
    notes = [f"{task.title}: session {store.facts.name}, after {len(trials_of(store))} trials."]
    notes += [
        f"{d.title} = {mean:.4g}, {share} % of the posterior between {a:.4g} and {b:.4g}"
        for d, mean, a, b in zip(task.parameters.dimensions, known.mean, low, high, strict=True)
    ]
    facts = {
        "session": store.facts.name,
        "task": task.name,
        "parameters": _named(task.parameters, known.mean),
        "interval": _named(task.parameters, np.stack([low, high], axis=-1)),
        "context": _named(task.context, context),
        "action": _named(task.action, action),
        "units": store.facts.units,
    }
    return (as_sdf if kind == "sdf" else as_mjcf)(trial, facts, notes)


def _named(space: Space, values: Any) -> dict[str, Any]:
    return dict(zip(space.names, np.asarray(values).tolist(), strict=True))
