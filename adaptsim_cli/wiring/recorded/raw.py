"""One trial as read from a file, before it is checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.errors import RecordingsRefused
from sim.rollouts.recorded import RecordedTrials, scores_only
from sim.tasks.task import Task
from sim.types import Space

REWARD, OUTCOME, TRIAL, TIME = "reward", "outcome", "trial", "t_s"
AGREES = 0.02
"""How far a recorded reward may be from that of the task."""


@dataclass(frozen=True, eq=False)
class RawTrial:
    """The values of a trial by name; what nobody asks for is kept and not used."""

    name: str
    values: Mapping[str, float | str]
    t_s: Array  # (N,)
    state: Array  # (N, d)
    end_in_tool_m: Array = field(default_factory=lambda: np.full(3, np.nan))


def checked(task: Task, raw: Sequence[RawTrial], outcome: Outcome | None) -> RecordedTrials:
    """The trials as the task knows them. Raises RecordingsRefused."""
    named = set(raw[0].values) if raw else set()
    has_context = set(task.context.names) <= named
    if not has_context and not scores_only(task):
        missing = ", ".join(name for name in task.context.names if name not in named)
        raise RecordingsRefused(f"the context {missing} is missing, and in {task.name} it changes the motion: name it")
    trials = RecordedTrials(
        task,
        tuple(trial.name for trial in raw),
        np.array([_point(trial, task.context) for trial in raw]) if has_context else None,
        np.array([_point(trial, task.action) for trial in raw]).reshape(len(raw), len(task.action)),
        tuple(_track(trial, outcome) for trial in raw),
    )
    if trials.contexts is not None and REWARD in named:
        _require_rewards(trials, raw)
    return trials


def _point(trial: RawTrial, space: Space) -> Array:
    return np.array([_number(trial, name) for name in space.names])


def _number(trial: RawTrial, name: str) -> float:
    try:
        value = float(trial.values[name])
    except KeyError as error:
        known = ", ".join(sorted(trial.values))
        raise RecordingsRefused(f"trial {trial.name}: {name} is missing; there are {known}") from error
    except (TypeError, ValueError) as error:
        raise RecordingsRefused(f"trial {trial.name}: {name} = {trial.values[name]!r} is no number") from error
    if not math.isfinite(value):
        raise RecordingsRefused(f"trial {trial.name}: {name} = {value:g} is not finite")
    return value


def _track(trial: RawTrial, outcome: Outcome | None) -> ObjectTrack:
    n = len(trial.t_s)
    if trial.state.shape[:1] != (n,):
        raise RecordingsRefused(f"trial {trial.name}: it has {n} times and {len(trial.state)} states")
    try:
        return ObjectTrack(trial.t_s, trial.state, outcome or _outcome(trial), trial.end_in_tool_m, np.ones(n))
    except ValueError as error:
        raise RecordingsRefused(f"trial {trial.name}: {error}") from error


def _outcome(trial: RawTrial) -> Outcome:
    known = ", ".join(Outcome)
    if OUTCOME not in trial.values:
        raise RecordingsRefused(
            f"trial {trial.name}: its outcome is missing: name its column, or one outcome for all, of {known}"
        )
    try:
        return Outcome(str(trial.values[OUTCOME]))
    except ValueError as error:
        raise RecordingsRefused(
            f"trial {trial.name}: outcome {trial.values[OUTCOME]!r} is not known: it must be one of {known}"
        ) from error


def _require_rewards(trials: RecordedTrials, raw: Sequence[RawTrial]) -> None:
    """Raises RecordingsRefused if the task scores a trial otherwise than its recording."""
    for trial, track, context in zip(
        raw, trials.tracks, [] if trials.contexts is None else trials.contexts, strict=True
    ):
        said, scored = _number(trial, REWARD), trials.task.score(track, context)
        if abs(said - scored) > AGREES:
            raise RecordingsRefused(
                f"trial {trial.name}: its recorded reward is {said:.3f}, and the task scores it {scored:.3f}: "
                "check columns and units, or leave the rewards out"
            )
