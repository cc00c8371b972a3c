"""The state of the live page, as plain JSON. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.screen.views import number
from adaptsim_cli.session.advice import in_words
from adaptsim_cli.session.operator import Proposal
from adaptsim_cli.session.records import ResultRecord, TrialRecord
from adaptsim_cli.session.store import SessionStore, results_of, trials_of
from adaptsim_cli.session.target import MotionPreview, TrackedTrial
from sim.adaptation.posterior import Posterior
from sim.tasks.task import Task
from sim.types import Space

BINS = 24
"""Number of bins of one parameter's posterior, over its range."""


def quantities(space: Space, point: Mapping[str, float]) -> list[dict[str, str]]:
    """Plain name, readable value, unit and meaning of each quantity."""
    return [
        {"name": d.name, "plain": d.plain_name, "value": number(point[d.name]), "unit": d.unit, "meaning": d.meaning}
        for d in space.dimensions
    ]


def trial(task: Task, particles: int, made: Proposal) -> dict[str, Any]:
    """A proposed trial in words."""
    trial = made.trial
    return {
        "number": trial.trial,
        "attempt": trial.attempt,
        "iteration": trial.iteration,
        "particle": trial.particle,
        "particles": particles,  # 0: a single rollout
        "parameters": quantities(task.parameters, trial.parameters),
        "context": quantities(task.context, trial.context),
        "action": quantities(task.action, trial.action),
        "expected": [trial.predicted_reward, trial.predicted_low, trial.predicted_high],
        "summary": made.summary,
    }


def motion(preview: MotionPreview) -> dict[str, Any]:
    """The planned motion of the arm, and the marks on the table, in m."""
    return {
        "t_s": _rounded(preview.t_s, 3),
        "arm_m": _rounded(preview.arm_m, 4),
        "path_m": _rounded(preview.path_m, 4),
        "motion_s": list(preview.motion_s),
        "spot_m": _rounded(preview.spot_m, 4),
        "area_m": _rounded(preview.area_m, 4),
        "goal_m": None if preview.goal_m is None else _rounded(preview.goal_m, 4),
    }


def picture(preview: MotionPreview, name: str) -> dict[str, Any]:
    """The camera's picture, and its overlay in pixels."""
    width, height = preview.size_px
    return {"url": f"picture/{name}", "width": width, "height": height, "path_px": _rounded(preview.path_px, 1)}


def tracked(record: TrialRecord, seen: TrackedTrial, url: str) -> dict[str, Any]:
    """A tracked trial, before its review; `url` is that of its film."""
    state = seen.track.state
    return {
        "outcome": record.outcome_words,
        "reward": record.reward,
        "flags": list(record.track.flags),
        "track_px": _rounded(seen.track_px, 1),
        "track_m": _rounded(state[:, :3], 4) if state.shape[1] >= 3 else [],
        "film": None if record.film is None else {"url": url, "end_s": record.film.end_s},
    }


def so_far(store: SessionStore, task: Task, posterior: Posterior | None) -> dict[str, Any]:
    """Rewards and parameters of the whole session."""
    trials = trials_of(store)
    results = results_of(store)
    return {
        "rewards": [_reward(record) for record in trials],
        "per_iteration": store.facts.particles * store.facts.trials,
        "parameters": _parameters(store, task, results, posterior),
        "verdict": in_words(results[-1].verdict, store.facts.object_name) if results else "",
        "best": _best(task, results[-1]) if results else None,
    }


def _reward(record: TrialRecord) -> dict[str, Any]:
    return {
        "number": record.trial,
        "particle": record.particle,
        "reward": record.reward,
        "expected": [record.predicted_low, record.predicted_high],
        "outcome": record.outcome_words,
    }


def _best(task: Task, result: ResultRecord) -> dict[str, Any]:
    best = result.best
    at = quantities(task.parameters, best.params)
    return {"reward": best.mean_reward, "ci95": list(best.ci95), "trials": best.trials, "at": at}


def _parameters(
    store: SessionStore, task: Task, results: Sequence[ResultRecord], posterior: Posterior | None
) -> list[dict[str, Any]]:
    """Each parameter with its range, the particles of every iteration as fractions of the range, and the posterior."""
    space = task.parameters
    steps = [store.start.particles, *(result.next_particles for result in results)]
    means = np.array([[np.mean(samples, axis=0) for samples in particles] for particles in steps])  # (I + 1, n, p)
    unit = space.normalise(means)
    told = None if posterior is None else _marginals(space, posterior)
    return [
        {
            "name": d.name,
            "plain": d.plain_name,
            "unit": d.unit,
            "meaning": d.meaning,
            "low": number(d.low),
            "high": number(d.high),
            "steps": _rounded(unit[:, :, k], 4),
            "now": [number(float(v)) for v in means[-1, :, k]],
            "posterior": None if told is None else told[k],
        }
        for k, d in enumerate(space.dimensions)
    ]


def _marginals(space: Space, posterior: Posterior) -> list[list[float]]:
    """For each parameter, the probability of each of `BINS` parts of its range; values beyond count at the ends."""
    unit = np.clip(space.normalise(posterior.samples), 0.0, 1.0 - 1e-9)
    return [
        _rounded(np.bincount((BINS * column).astype(int), weights=posterior.weights, minlength=BINS), 5)
        for column in unit.T
    ]


def _rounded(values: NDArray[Any], digits: int) -> list[Any]:
    rounded: list[Any] = np.round(np.nan_to_num(np.asarray(values, dtype=float)), digits).tolist()
    return rounded
