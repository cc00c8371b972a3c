"""The state of the live page, as plain JSON. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.screen.values import number
from adaptsim_cli.session.advice import in_words
from adaptsim_cli.session.operator import Judged, Proposal
from adaptsim_cli.session.records import ResultRecord, TrialRecord
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.watching import Seen, Sight
from hw.types import Array
from perception.types import ObjectTrack
from sim.adaptation.posterior import Posterior
from sim.tasks.task import Task
from sim.types import Space

BINS = 24
"""Number of bins of one parameter's posterior, over its range."""


def quantities(space: Space, point: Sequence[float] | Array) -> list[dict[str, str]]:
    """Plain name, readable value, unit and meaning of each quantity."""
    return [
        {"name": d.name, "plain": d.plain_name, "value": number(float(v)), "unit": d.unit, "meaning": d.meaning}
        for d, v in zip(space.dimensions, point, strict=True)
    ]


def trial(task: Task, particles: int, made: Proposal) -> dict[str, Any]:
    """A proposed trial in words."""
    stage, expected = made.stage, made.prediction
    return {
        "number": stage.key.number,
        "attempt": stage.key.attempt + 1,
        "iteration": stage.iteration + 1,
        "particle": stage.particle + 1,
        "particles": particles,  # 0: a single rollout
        "parameters": quantities(task.parameters, made.parameters),
        "context": quantities(task.context, made.context),
        "action": quantities(task.action, made.action),
        "expected": [expected.reward, expected.low, expected.high],
        "summary": made.summary,
    }


def motion(sight: Sight) -> dict[str, Any]:
    """The planned motion of the arm, and the marks on the table, in m."""
    return {
        "t_s": _rounded(sight.t_s, 3),
        "arm_m": _rounded(sight.arm_m, 4),
        "path_m": _rounded(sight.path_m, 4),
        "motion_s": list(sight.motion_s),
        "spot_m": _rounded(sight.spot_m, 4),
        "area_m": _rounded(sight.area_m, 4),
        "goal_m": None if sight.goal_m is None else _rounded(sight.goal_m, 4),
    }


def picture(sight: Sight, name: str) -> dict[str, Any]:
    """The camera's picture, and its overlay in pixels."""
    width, height = sight.size_px
    return {"url": f"picture/{name}", "width": width, "height": height, "path_px": _rounded(sight.path_px, 1)}


def judged(found: Judged, track: ObjectTrack, seen: Seen, urls: Mapping[str, str]) -> dict[str, Any]:
    """A tracked trial, before its review."""
    has_place = track.state.shape[1] >= 3
    return {
        "outcome": found.outcome.value.replace("_", " "),
        "reward": found.reward,
        "flags": list(found.flags),
        "track_px": _rounded(seen.track_px, 1),
        "track_m": _rounded(track.state[:, :3], 4) if has_place else [],
        "moments": [{"label": m.label, "t_s": round(m.t_s, 2), "url": urls[m.file]} for m in seen.moments],
    }


def so_far(store: SessionStore, task: Task, posterior: Posterior | None) -> dict[str, Any]:
    """Rewards and parameters of the whole session."""
    trials = [record for i in range(store.iterations()) for record in store.trials(i)]
    results = [result for i in range(store.iterations()) if (result := store.result(i)) is not None]
    return {
        "rewards": [_reward(record) for record in trials],
        "per_iteration": store.facts.particles * store.facts.trials,
        "parameters": _parameters(store, task, results, posterior),
        "verdict": in_words(results[-1].verdict, store.facts.object_name) if results else "",
        "best": _best(task, results[-1]) if results else None,
    }


def _reward(record: TrialRecord) -> dict[str, Any]:
    return {
        "number": record.number,
        "particle": record.particle,
        "reward": record.reward,
        "expected": [record.predicted_low, record.predicted_high],
        "outcome": record.outcome.value.replace("_", " "),
    }


def _best(task: Task, result: ResultRecord) -> dict[str, Any]:
    best = result.best
    point = [best.params[name] for name in task.parameters.names]
    at = quantities(task.parameters, point)
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
