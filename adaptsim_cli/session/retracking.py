"""Runs this version's tracker on the stored recordings of a session. Changes nothing stored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from adaptsim_cli.bench.rig import Tracker, TrackRequest
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.screen.outputs.sessions import Now, RetrackedTrial, Stored
from adaptsim_cli.screen.outputs.trials import named
from adaptsim_cli.screen.views import words
from adaptsim_cli.session import recording, topics
from adaptsim_cli.session.history import played_of
from adaptsim_cli.session.records import TrialRecord, corrupt
from adaptsim_cli.session.store import SessionStore
from hw.types import Array
from perception.errors import PerceptionError, TrackingFailed
from sim.tasks.task import Task

HEAD = ("trial", "stored outcome", "now", "stored reward", "now", "end apart mm", "most apart mm")


def retrack(store: SessionStore, task: Task, tracker: Tracker, trial: int | None) -> Iterator[RetrackedTrial]:
    """Every completed trial that counts, in order, or only `trial` (numbered from 1).

    A trial that can no longer be tracked carries its failure. Raises UsageError if there is no such trial, SessionError
    naming a missing or damaged file.
    """
    records: Sequence[TrialRecord] = played_of(store)
    if trial is not None:
        numbers = ", ".join(str(record.trial) for record in records) or "none"
        records = [record for record in records if record.trial == trial]
        if not records:
            raise UsageError(
                f"--trial {trial}: no such trial of {store.facts.name} is completed and counts; there are: {numbers}"
            )
    if not records:
        raise SessionError(f"session {store.facts.name} has no completed trial yet; nothing to track")
    for record in records:
        yield _again(store, task, tracker, record)


def rows(trials: Sequence[RetrackedTrial]) -> list[tuple[str, ...]]:
    """The columns of `HEAD` as text, one row per trial."""
    return [
        (
            str(one.trial),
            words(one.stored.outcome) + (" (operator)" if one.stored.outcome != one.stored.tracked_outcome else ""),
            "not tracked" if one.now is None else words(one.now.outcome),
            f"{one.stored.reward:.2f}",
            _number(None if one.now is None else one.now.reward),
            _number(one.end_apart_mm),
            _number(one.most_apart_mm),
        )
        for one in trials
    ]


def next_steps(session: str, trials: Sequence[RetrackedTrial]) -> tuple[tuple[str, str], ...]:
    """(command, reason) for each trial with another outcome than before: a person decides."""
    others = [one.trial for one in trials if one.now is not None and not one.same_outcome]
    look = tuple(
        (f"adaptsim sessions amend {session} {n}", f"trial {n} now has another outcome: check it") for n in others
    )
    return look or ((f"adaptsim run-iteration --session {session}", "continues the session"),)


def failure(trials: Sequence[RetrackedTrial]) -> TrackingFailed | None:
    """An error that names every trial that was tracked before and cannot be tracked now; None if there is no such
    trial.
    """
    failed = [f"trial {one.trial}: {one.failure}" for one in trials if one.now is None]
    if not failed:
        return None
    return TrackingFailed(f"{len(failed)} of {len(trials)} trials cannot be tracked now; " + "; ".join(failed))


def require_camera(task: Task) -> None:
    """Raises UsageError for a task without a camera."""
    if task.hardware is None:
        raise UsageError(f"the task {task.name} runs in simulation only: its sessions have no recordings to track")


def _again(store: SessionStore, task: Task, tracker: Tracker, record: TrialRecord) -> RetrackedTrial:
    path = store.trial_folder(*record.position) / recording.FILE
    stored, X_BT_at = recording.read(path), tool_poses(path)
    played = stored.execution
    if not len(played.t_s):
        raise corrupt(path, "it holds no joints")
    old, now, apart_mm, failure = record.track.track(), None, None, None
    tracked = record.overruled_from or record.outcome
    try:
        detection = tracker.find(stored.before, stored.model, stored.X_BC)
        track = tracker.track(TrackRequest(stored, detection, X_BT_at, float(played.t_s[-1])))
        track = tracker.at_home(track, detection, stored)
    except PerceptionError as error:
        failure = str(error)
    else:
        context = tracker.context(np.array(list(record.drawn_context.values())), detection)
        apart_mm = 1e3 * np.linalg.norm(track.at(old.t_s) - old.state, axis=1)
        now = Now(
            outcome=track.outcome.value,
            reward=task.score(track, context),
            context=named(list(record.context), context),
            flags=list(track.flags),
        )
    return RetrackedTrial(
        trial=record.trial,
        iteration=record.iteration,
        attempt=record.attempt,
        stored=Stored(
            outcome=record.outcome.value,
            tracked_outcome=tracked.value,
            reward=record.reward,
            context=record.context,
            flags=list(record.track.flags),
        ),
        now=now,
        same_outcome=now is not None and now.outcome == tracked.value,
        end_apart_mm=None if apart_mm is None else float(apart_mm[-1]),
        most_apart_mm=None if apart_mm is None else float(apart_mm.max()),
        failure=failure,
    )


def tool_poses(path: Path) -> Callable[[float], Array]:
    """Time on the recording's clock -> tool pose (4, 4) in the base frame that the first tracking used.

    Stored at every image, interpolated in between, held beyond the ends. Raises SessionError naming the file.
    """
    with recording.opened(path) as reader:
        stored = sorted(_tool_messages(reader), key=lambda pose: pose[0])
    if not stored:
        raise corrupt(path, "it holds no pose of the tool")
    t_s = np.array([1e-9 * t_ns for t_ns, _, _ in stored])
    p_m = np.array([p for _, p, _ in stored])
    turned = Rotation.from_quat(np.array([xyzw for _, _, xyzw in stored]))
    between = Slerp(t_s, turned) if len(t_s) > 1 else None

    def at(time_s: float) -> Array:
        held_s = float(np.clip(time_s, t_s[0], t_s[-1]))
        X_BT = np.eye(4)
        X_BT[:3, :3] = (between(held_s) if between is not None else turned[0]).as_matrix()
        X_BT[:3, 3] = [np.interp(held_s, t_s, column) for column in p_m.T]
        return X_BT

    return at


def _tool_messages(reader: Any) -> Iterator[tuple[int, tuple[float, ...], tuple[float, ...]]]:
    """(time in ns, position in m, quaternion xyzw) of every transform to the tool; `topics.transform` wrote them."""
    for _, _, message in reader.iter_messages(topics=["/tf"]):
        for frame in topics.decode(topics.TRANSFORM, message.data).transforms:
            if frame.child_frame_id == "tool":
                p, q = frame.transform.translation, frame.transform.rotation
                yield topics.stamp_ns(frame.header), (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
