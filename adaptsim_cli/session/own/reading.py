"""From the bytes of an answer to a checked track. Every defect is one sentence that names the value and the limit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from adaptsim_cli.errors import AnswerRefused, explained
from adaptsim_cli.screen.outputs.exchange import VERSION, Answer, Question
from hw.types import Array
from perception.types import ObjectTrack
from sim.errors import OutOfRange
from sim.rollouts.recorded import LONGEST_GAP_S, NEAR_S, START_M, WIDENED, rests, start_m
from sim.rollouts.trajectories import contradiction
from sim.tasks.task import Task

MOST_BYTES = 16 * 2**20
"""An answer is a table of a few thousand rows at most."""


def read_answer(content: bytes, question: Question) -> Answer:
    """The answer in the output of a program or in a file: all of it, or its last line. Raises AnswerRefused."""
    if len(content) > MOST_BYTES:
        raise AnswerRefused(
            f"it has {len(content) / 2**20:.0f} MB, limit {MOST_BYTES // 2**20}: report 10 to 100 states a second"
        )
    table = _table(content)
    try:
        answer = Answer.model_validate(_tuples(table))
    except ValidationError as error:
        raise AnswerRefused(f"{explained(error)} (its keys: adaptsim schema own-robot answer)") from error
    if answer.adaptsim != VERSION:
        raise AnswerRefused(
            f"adaptsim = {answer.adaptsim}: this version of adaptsim reads answers of version {VERSION}"
        )
    if answer.trial != question.trial:
        raise AnswerRefused(f"it answers trial {answer.trial}, but trial {question.trial} was asked for")
    _require_one_kind(answer, question)
    return answer


def _table(content: bytes) -> Mapping[str, Any]:
    try:
        text = content.decode("utf-8-sig").strip()
    except UnicodeDecodeError as error:
        raise AnswerRefused(f"it is not text in UTF-8 (byte {error.start}): print one JSON object") from error
    if not text:
        raise AnswerRefused("it is empty: print one JSON object, at the end of the output")
    for part in (text, text.splitlines()[-1]):
        try:
            table = json.loads(part, object_pairs_hook=_without_repeats)
        except (json.JSONDecodeError, RecursionError):
            continue
        if isinstance(table, dict):
            return table
        raise AnswerRefused(f"it is a JSON {type(table).__name__}, and must be one object in braces")
    raise AnswerRefused(f"neither all of it nor its last line is JSON: {text.splitlines()[-1][:80]!r}")


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of these keys and values. Raises AnswerRefused if a key is there twice."""
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        repeated = next(name for name in names if names.count(name) > 1)
        raise AnswerRefused(f"it has {repeated} twice: leave one of them out")
    return table


def _tuples(value: Any) -> Any:
    """Lists as tuples, all the way down."""
    if isinstance(value, dict):
        return {key: _tuples(inner) for key, inner in value.items()}
    return tuple(_tuples(inner) for inner in value) if isinstance(value, list) else value


def _require_one_kind(answer: Answer, question: Question) -> None:
    if answer.rejected is not None or answer.impossible is not None:
        if answer.rejected is not None and answer.impossible is not None:
            raise AnswerRefused(
                "it says both rejected and impossible: rejected repeats the trial, impossible asks for another action"
            )
        if not (answer.rejected or answer.impossible or "").strip():
            raise AnswerRefused("it rejects the trial without a reason: write one sentence")
        return
    if question.ask == "place":
        if answer.context is None:
            raise AnswerRefused(f"context is missing: report where the object lies, {', '.join(question.context)}")
        return
    if answer.context is not None:
        raise AnswerRefused("context was not asked for: report it only in the answer to ask = place")
    if (answer.t_s is None) != (answer.state is None):
        raise AnswerRefused(f"{'t_s' if answer.t_s is None else 'state'} is missing: times and states belong together")
    if answer.t_s is None and answer.end is None:
        raise AnswerRefused(
            "t_s and state are missing, and end too: report the trajectory, or where the object came to rest"
        )
    if answer.t_s is not None and answer.end is not None:
        raise AnswerRefused("it has a trajectory and an end: the last row of state is the end, so leave end out")


def measured_context(answer: Answer, question: Question, task: Task) -> Array:
    """(c,) the context that an answer to `place` measured. Raises AnswerRefused."""
    measured = answer.context or {}
    if set(measured) != set(task.context.names):
        raise AnswerRefused(
            f"context names {', '.join(measured) or 'nothing'}, and must name {', '.join(task.context.names)}"
        )
    point = np.array([measured[name] for name in task.context.names], dtype=np.float64)
    try:
        task.context.check(point, "context")
    except OutOfRange as error:
        raise AnswerRefused(f"{error}: put the object back into the area, or check unit and frame") from error
    return point


def track_of(answer: Answer, question: Question, task: Task) -> ObjectTrack:
    """The track of a trial; unobserved quantities are missing. Raises AnswerRefused."""
    report = task.require_report()
    outcome = answer.outcome
    if outcome is None and len(report.outcomes) == 1:
        outcome = report.outcomes[0]
    listing = ", ".join(report.outcomes)
    if outcome is None:
        raise AnswerRefused(f"outcome is missing: it must be one of {listing}")
    if outcome not in report.outcomes:
        raise AnswerRefused(f"outcome = {outcome.value}: a trial of {task.name} ends as one of {listing}")
    t_s, state = _samples(answer, task, report.columns)
    end_m = np.full(3, np.nan) if answer.end_in_tool_m is None else np.array(answer.end_in_tool_m)
    track = ObjectTrack(t_s, state, outcome, end_m, np.ones(len(t_s)))
    last_s = np.inf if answer.rest_s is not None or answer.end is not None or rests(task, track) else float(t_s[-1])
    if answer.rest_s is not None and answer.end is None:
        _require_rest(answer.rest_s, track, task)
    track = ObjectTrack(
        t_s,
        state,
        outcome,
        end_m,
        np.ones(len(t_s)),
        watched_s=(float(t_s[0]), last_s),
        flags=_flags(answer, t_s, last_s, task),
    )
    _require_plausible(track, question, task)
    context = np.array([question.context[name] for name in task.context.names])
    if wrong := contradiction(task, _from_start(track, task, context), context, action_of(question, task)):
        raise AnswerRefused(wrong)
    if not np.isfinite(task.score(track, context)):
        raise AnswerRefused(
            f"outcome = {outcome.value} is a success, and its reward needs the object's last place in the tool's "
            "frame: add end_in_tool_m, (x, y, z) in m"
        )
    return track


def _from_start(track: ObjectTrack, task: Task, context: Array) -> ObjectTrack:
    """The track; one that has only an end begins at the known start of the object."""
    place_m = start_m(task, context)
    if len(track.t_s) > 1 or place_m is None:
        return track
    start = np.concatenate([place_m, track.state[0, 2:]])
    return ObjectTrack(
        np.array([0.0, track.t_s[0]]), np.array([start, track.state[0]]), track.outcome, track.end_in_tool_m, np.ones(2)
    )


def action_of(question: Question, task: Task) -> Array:
    """(a,) the commanded action, in units."""
    return np.array([(question.action or {})[name] for name in task.action.names])


def _samples(answer: Answer, task: Task, columns: tuple[str, ...]) -> tuple[Array, Array]:
    """Times (N,) and states (N, d). Raises AnswerRefused."""
    width = f"{len(columns)} numbers ({', '.join(columns)})"
    if answer.end is not None:
        if len(answer.end) != len(columns):
            raise AnswerRefused(f"end has {len(answer.end)} numbers, and must have {width}")
        after_s = float(np.nextafter(task.observation.times_s[-1], np.inf)) + 1e-3  # no observed moment is known
        return np.array([after_s if answer.rest_s is None else answer.rest_s]), np.array([answer.end])
    times, rows = answer.t_s or (), answer.state or ()
    if len(times) != len(rows):
        raise AnswerRefused(f"t_s has {len(times)} times, and state has {len(rows)} rows: give one row for each time")
    if len(times) < 2:
        raise AnswerRefused(f"the trajectory has {len(times)} states, and needs two: to report only the end, give end")
    wrong = next((i for i, row in enumerate(rows) if len(row) != len(columns)), None)
    if wrong is not None:
        raise AnswerRefused(f"row {wrong + 1} of state has {len(rows[wrong])} numbers, and must have {width}")
    t_s, state = np.array(times, dtype=np.float64), np.array(rows, dtype=np.float64)
    back = np.flatnonzero(np.diff(t_s) <= 0.0)
    if len(back):
        raise AnswerRefused(
            f"t_s does not increase after {t_s[back[0]]:.4g} s: the next time is {t_s[back[0] + 1]:.4g} s"
        )
    if abs(t_s[0]) > NEAR_S:
        raise AnswerRefused(
            f"its first state is at {t_s[0]:.6g} s, but must lie within {NEAR_S:g} s of time 0, the start of the "
            "motion: subtract the start of the motion from the clock, and leave out all earlier states"
        )
    if t_s[-1] <= 0.0:
        raise AnswerRefused(f"its last state is at {t_s[-1]:.4g} s, and time 0 is the start of the motion")
    end_s = float(task.observation.times_s[-1])
    gaps = np.diff(t_s[: int(np.searchsorted(t_s, end_s)) + 1])
    if len(gaps) and gaps.max() > LONGEST_GAP_S:
        at_s = float(t_s[int(gaps.argmax())])
        raise AnswerRefused(
            f"after {at_s:.4g} s there is no state for {gaps.max():.4g} s, limit {LONGEST_GAP_S:g}: is t_s in seconds, "
            "and is no part lost?"
        )
    return t_s, state


def _require_rest(rest_s: float, track: ObjectTrack, task: Task) -> None:
    observation, last_s = task.observation, float(track.t_s[-1])
    if rest_s > last_s + NEAR_S:
        raise AnswerRefused(
            f"rest_s = {rest_s:g}, and the last state is at {last_s:.4g} s: is rest_s in seconds since the start of "
            "the motion? Report states until the object rests"
        )
    later = track.state[track.t_s >= rest_s][:, list(observation.columns)]
    moved = float((np.ptp(later, axis=0) / (observation.high - observation.low)).max()) if len(later) > 1 else 0.0
    if moved > 0.05:
        raise AnswerRefused(
            f"rest_s = {rest_s:g}, and after it the object moved by {moved:.0%} of the task's range: name a later time"
        )


def _require_plausible(track: ObjectTrack, question: Question, task: Task) -> None:
    """Refuse states of another unit, and a start in another frame. Raises AnswerRefused."""
    sight = task.observation
    columns, wide = list(sight.columns), WIDENED * (sight.high - sight.low)
    states, low, high = track.state[:, columns], sight.low - wide, sight.high + wide
    outside = np.argwhere((states < low) | (states > high))
    if len(outside):
        row, column = outside[0]
        name = question.state[columns[column]]
        raise AnswerRefused(
            f"{name} = {states[row, column]:.4g} at {track.t_s[row]:.3g} s, and {task.name} expects {low[column]:.3g} "
            f"to {high[column]:.3g}: are the states in these units and in the task's frame?"
        )
    place_m = start_m(task, np.array([question.context[name] for name in task.context.names]))
    if place_m is None or track.t_s[0] > 0.0 or track.t_s[-1] < 0.0:
        return
    x_m, y_m = track.at(np.zeros(1))[0, :2]
    off_m = float(np.hypot(x_m - place_m[0], y_m - place_m[1]))
    if off_m > START_M:
        raise AnswerRefused(
            f"at time 0 the object lies at ({x_m:.3f}, {y_m:+.3f}) m, {1e3 * off_m:.0f} mm from its start at "
            f"({place_m[0]:.3f}, {place_m[1]:+.3f}) m, limit {1e3 * START_M:.0f}: are x and y in this order, in m, in "
            "the task's frame, and is time 0 the start of the motion?"
        )


def _flags(answer: Answer, t_s: Array, last_s: float, task: Task) -> tuple[str, ...]:
    times_s = task.observation.times_s
    missing = int(((times_s < t_s[0] - 1e-6) | (times_s > last_s + 1e-6)).sum())
    notes = [answer.note] if answer.note else []
    if missing == len(times_s):
        notes.append("only its end was observed: reward and end count, the posterior of the parameters stays as it was")
    elif missing:
        notes.append(f"{missing} of {len(times_s)} moments were not observed and do not count")
    return tuple(notes)
