"""A scene for another simulator, with the parameters or ranges that a session found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsim_cli.session.best import policy_of_session
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.store import SessionStore

if TYPE_CHECKING:
    from sim.types import Space


INTERVAL = (0.05, 0.95)
"""Levels between which the stated share of the posterior lies."""


def scene_files(store: SessionStore, kind: str) -> dict[str, bytes]:
    """Name -> content of `ranges`, or of the scene as `sdf` or `mjcf`.

    A scene is at the posterior mean; its context is that of the newest trial.

    Raises NoHardware for a task without a scene, SessionError before the first complete iteration, CheckpointError,
    OutOfRange, ExtraMissing.
    """
    if kind == "ranges":
        from adaptsim_cli.session.ranges import ranges_files

        return ranges_files(store)
    from adaptsim_cli.session.hindsight import Hindsight
    from sim.adaptation.posterior import COLLAPSED
    from sim.lab.scene_files import SceneTrial, as_mjcf, as_sdf

    hindsight = Hindsight.of(store)
    task = hindsight.checkpoint.solver.task
    task.require_hardware()
    posterior = hindsight.posterior(store)
    interval = None if posterior.is_collapsed else posterior.quantiles(INTERVAL)
    ends = [COLLAPSED] * len(task.parameters)
    if interval is not None:
        share = round(100 * (INTERVAL[1] - INTERVAL[0]))
        ends = [f"{share} % of the posterior between {low:.4g} and {high:.4g}" for low, high in interval.T]
    context = trials_of(store)[-1].context_array
    action = policy_of_session(store, hindsight.checkpoint)(context)
    trial = SceneTrial(task, posterior.mean, context, action)
    notes = [f"{task.title}: session {store.facts.name}, after {len(trials_of(store))} trials."]
    notes += [
        f"{d.title} = {mean:.4g}, {between}"
        for d, mean, between in zip(task.parameters.dimensions, posterior.mean, ends, strict=True)
    ]
    facts = {
        "session": store.facts.name,
        "task": task.name,
        "parameters": _named(task.parameters, posterior.mean),
        "interval": None if interval is None else _named(task.parameters, interval.T),
        "context": _named(task.context, context),
        "action": _named(task.action, action),
        "units": store.facts.units,
    }
    return (as_sdf if kind == "sdf" else as_mjcf)(trial, facts, notes)


def _named(space: Space, values: Any) -> dict[str, Any]:
    return dict(zip(space.names, np.asarray(values).tolist(), strict=True))
