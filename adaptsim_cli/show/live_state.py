"""The state of a live page, as plain JSON: from the records of a session, and from a trial that is under way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.screen.views import number, scale_within, value_in_words, values
from adaptsim_cli.session.advice import best_in_words, check_first, compared_in_words, in_words
from adaptsim_cli.session.history import means_of, played_of, results_of
from adaptsim_cli.session.live_trial import MotionPreview, TrackedTrial
from adaptsim_cli.session.records import MotionRecord, ResultRecord, TrialRecord
from adaptsim_cli.session.store import SessionStore
from hw.types import Array
from sim.adaptation.posterior import Posterior
from sim.adaptation.stages import Role
from sim.tasks.task import Task
from sim.types import Dimension, Space

BINS = 24
"""Number of bins of one parameter's posterior, over its range."""


def live_html() -> str:
    """The page. It requests its state and its pictures from addresses below its own."""
    return (resources.files("adaptsim_cli.show") / "live.html").read_text(encoding="utf-8")


def head_of(task: Task, name: str, what: str, hardware: str, *, simulated: bool, camera: bool) -> dict[str, Any]:
    """The head of the page: `what` describes the session or rollout `name` in one line."""
    return {
        "simulated": simulated,
        "hardware": hardware,
        "name": name,
        "what": what,
        "task": task.title[:1].upper() + task.title[1:],
        "object": task.object_name,
        "camera": camera,
    }


def quantities(space: Space, point: Mapping[str, float]) -> list[dict[str, str]]:
    """Plain name, value with its unit or its word, and meaning of each quantity."""
    return [
        {"name": d.name, "plain": d.plain_name, "value": value_in_words(d, point[d.name]), "meaning": d.meaning}
        for d in space.dimensions
    ]


def trial_shown(task: Task, particles: int, trial: MotionRecord, summary: str) -> dict[str, Any]:
    """A proposed trial in words."""
    return {
        "number": trial.trial,
        "attempt": trial.attempt,
        "iteration": trial.iteration,
        "particle": trial.particle,
        "particles": particles,  # 0: a single rollout
        "parameters": [] if trial.is_blind else quantities(task.parameters, trial.parameters),
        "context": quantities(task.context, trial.context),
        "action": quantities(task.action, trial.action),
        "expected": None if trial.is_blind else [trial.predicted_reward, trial.predicted_low, trial.predicted_high],
        "summary": summary,
    }


def motion_shown(preview: MotionPreview) -> dict[str, Any]:
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


def picture_shown(preview: MotionPreview, name: str) -> dict[str, Any]:
    """The camera's picture, and its overlay in pixels."""
    width, height = preview.size_px
    return {"url": f"picture/{name}", "width": width, "height": height, "path_px": _rounded(preview.path_px, 1)}


def tracked_shown(record: TrialRecord, tracked_trial: TrackedTrial, url: str) -> dict[str, Any]:
    """A tracked trial, before its review; `url` is that of its film."""
    state = tracked_trial.track.state
    return {
        "outcome": record.outcome_words,
        "reward": record.reward,
        "flags": list(record.track.flags),
        "track_px": _rounded(tracked_trial.track_px, 1),
        "track_m": _rounded(state[:, :3], 4) if state.shape[1] >= 3 else [],
        "film": None if record.film is None else {"url": url, "end_s": record.film.end_s},
    }


def so_far(store: SessionStore, task: Task, posterior: Posterior | None) -> dict[str, Any]:
    """Rewards and parameters of the whole session."""
    results, facts, layout = results_of(store), store.facts, store.facts.layout
    first = check_first(facts.task, facts.hw, facts.calibration)
    return {
        "rewards": [_reward(record, len(results)) for record in played_of(store)],
        "ends": [layout.numbers(i).stop - 1 for i in range(max(1, store.iterations()))],
        "control": compared_in_words(results[-1].control) if results and results[-1].control is not None else "",
        "parameters": _parameters(store, task, results, posterior),
        "verdict": in_words(results[-1].verdict, store.facts.object_name, first=first) if results else "",
        "best": _best(task, results[-1]) if results else "",
    }


def _reward(record: TrialRecord, complete: int) -> dict[str, Any]:
    """A trial among all trials. Whose policy acted is shown once its iteration is among the `complete` ones."""
    is_control = record.role is Role.CONTROL and record.iteration <= complete
    return {
        "number": record.trial,
        "particle": record.particle,
        "reward": record.reward,
        "expected": None if record.is_blind else [record.predicted_low, record.predicted_high],
        "outcome": record.outcome_words + (", control" if is_control else ""),
        "control": is_control,
    }


def _best(task: Task, result: ResultRecord) -> str:
    params = result.best.params
    return best_in_words(result.best, values(task.parameters, np.array([params[n] for n in task.parameters.names])))


def _parameters(
    store: SessionStore, task: Task, results: Sequence[ResultRecord], posterior: Posterior | None
) -> list[dict[str, Any]]:
    """Each parameter with its range, the particles of every iteration as fractions of the range, and the posterior."""
    space = task.parameters
    means = means_of(store, results)
    unit = space.normalise(means)
    marginals = None if posterior is None or posterior.is_collapsed else _marginals(space, posterior)
    return [
        {
            "name": d.name,
            "plain": d.plain_name,
            "meaning": d.meaning,
            **_values(d, means[-1, :, k]),
            "steps": _rounded(unit[:, :, k], 4),
            "posterior": None if marginals is None else marginals[k],
        }
        for k, d in enumerate(space.dimensions)
    ]


def _values(dimension: Dimension, present: Array) -> dict[str, Any]:
    """The range of a parameter and its present values (n,), all in the unit in which people read this range, or as the
    words of a category.
    """
    if dimension.kinds:
        low, high, *now = (value_in_words(dimension, value) for value in (dimension.low, dimension.high, *present))
        return {"unit": "", "low": low, "high": high, "now": now}
    factor, unit = scale_within(dimension.low, dimension.high, dimension.unit)
    low, high, *now = (number(factor * float(value)) for value in (dimension.low, dimension.high, *present))
    return {"unit": unit, "low": low, "high": high, "now": now}


def _marginals(space: Space, posterior: Posterior) -> list[list[float]]:
    """The probability of each of `BINS` parts of every parameter's range; values beyond count at the ends."""
    unit = np.clip(space.normalise(posterior.samples), 0.0, 1.0 - 1e-9)
    return [
        _rounded(np.bincount((BINS * column).astype(int), weights=posterior.weights, minlength=BINS), 5)
        for column in unit.T
    ]


def _rounded(values: NDArray[Any], digits: int) -> list[Any]:
    rounded: list[Any] = np.round(np.nan_to_num(np.asarray(values, dtype=float)), digits).tolist()
    return rounded
