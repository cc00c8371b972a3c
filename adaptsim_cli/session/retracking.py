"""Runs this version's tracker on the stored recordings of a session. Changes nothing stored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.outputs.trials import named
from adaptsim_cli.session import recording, topics
from adaptsim_cli.session.on_rig import joints
from adaptsim_cli.session.records import Facts, TrialRecord, corrupt
from adaptsim_cli.session.store import SessionStore, trials_of
from adaptsim_cli.session.target import Tracker, TrackRequest
from hw.camera.replay import RecordedCamera, Take
from hw.types import Array
from perception.errors import PerceptionError, TrackingFailed
from perception.types import ObjectTrack
from sim.tasks.task import Task

HEAD = ("trial", "stored outcome", "now", "stored reward", "now", "end apart mm", "most apart mm")


@dataclass(frozen=True, eq=False)
class Retracked:
    """One trial: its stored track, and the track found now."""

    record: TrialRecord
    track: ObjectTrack | None  # None: tracking fails now
    reward: float | None
    context: Array | None  # (c,) as found now
    failure: str | None  # why it failed

    @property
    def end_apart_m(self) -> float | None:
        """Distance between the object's last positions, stored and now; None if one of them is unknown."""
        apart_m = self._apart_m()
        return None if apart_m is None else float(apart_m[-1])

    @property
    def most_apart_m(self) -> float | None:
        """The largest distance between the two tracks."""
        apart_m = self._apart_m()
        return None if apart_m is None else float(apart_m.max())

    @property
    def is_same_outcome(self) -> bool:
        """Compared with the tracked outcome, which an operator may have overruled."""
        return self.track is not None and self.track.outcome == self.record.track.outcome

    def as_json(self, facts: Facts) -> dict[str, Any]:
        """The object that `retrack --json` prints for a trial."""
        old, new = self.record, self.track
        return {
            "trial": old.trial,
            "iteration": old.iteration,
            "attempt": old.attempt,
            "stored": {
                "outcome": old.outcome.value,
                "tracked_outcome": old.track.outcome.value,
                "reward": old.reward,
                "context": old.context,
                "flags": list(old.track.flags),
            },
            "now": None
            if new is None
            else {
                "outcome": new.outcome.value,
                "reward": self.reward,
                "context": None if self.context is None else named([d.name for d in facts.context], self.context),
                "flags": list(new.flags),
            },
            "same_outcome": self.is_same_outcome,
            "end_apart_mm": _mm(self.end_apart_m),
            "most_apart_mm": _mm(self.most_apart_m),
            "failure": self.failure,
        }

    def _apart_m(self) -> Array | None:
        if self.track is None:
            return None
        old = self.record.track.track()
        return np.asarray(np.linalg.norm(self.track.at(old.t_s) - old.state, axis=1))


def retrack(store: SessionStore, task: Task, tracker: Tracker, trial: int | None) -> Iterator[Retracked]:
    """Every completed trial that counts, in order, or only `trial` (numbered from 1).

    A trial that can no longer be tracked carries its failure. Raises UsageError if there is no such trial, SessionError
    naming a missing or damaged file.
    """
    found: Sequence[TrialRecord] = trials_of(store)
    if trial is not None:
        known = ", ".join(str(record.trial) for record in found) or "none"
        found = [record for record in found if record.trial == trial]
        if not found:
            raise UsageError(
                f"--trial {trial}: no such trial of {store.facts.name} is completed and counts; there are: {known}"
            )
    if not found:
        raise SessionError(f"session {store.facts.name} has no completed trial yet; nothing to track")
    for record in found:
        yield _again(store, task, tracker, record)


def rows(found: Sequence[Retracked]) -> list[tuple[str, ...]]:
    """The columns of `HEAD` as text, one row per trial."""
    return [
        (
            str(one.record.trial),
            one.record.outcome_words + (" (operator)" if one.record.overruled_from else ""),
            "not tracked" if one.track is None else _words(one.track.outcome.value),
            f"{one.record.reward:.2f}",
            "–" if one.reward is None else f"{one.reward:.2f}",
            "–" if one.end_apart_m is None else f"{1e3 * one.end_apart_m:.2f}",
            "–" if one.most_apart_m is None else f"{1e3 * one.most_apart_m:.2f}",
        )
        for one in found
    ]


def next_steps(session: str, found: Sequence[Retracked]) -> tuple[tuple[str, str], ...]:
    """(command, reason) for each trial with another outcome than before: a person decides."""
    others = [one.record.trial for one in found if one.track is not None and not one.is_same_outcome]
    look = tuple(
        (f"adaptsim sessions amend {session} {n}", f"trial {n} now has another outcome: check it") for n in others
    )
    return look or ((f"adaptsim run-iteration --session {session}", "goes on with the session"),)


def require_tracked(found: Sequence[Retracked]) -> None:
    """Raises TrackingFailed naming every trial that was tracked before and cannot be tracked now."""
    failed = [f"trial {one.record.trial}: {one.failure}" for one in found if one.track is None]
    if failed:
        raise TrackingFailed(f"{len(failed)} of {len(found)} trials cannot be tracked now; " + "; ".join(failed))


def require_camera(task: Task) -> None:
    """Raises UsageError for a task without a camera."""
    if task.hardware is None:
        raise UsageError(f"the task {task.name} runs in simulation only: its sessions have no recordings to track")


def _again(store: SessionStore, task: Task, tracker: Tracker, record: TrialRecord) -> Retracked:
    path = store.trial_folder(*record.place) / recording.FILE
    stored, X_BT_at = recording.read(path), tool_poses(path)
    played = stored.execution
    if not len(played.t_s):
        raise corrupt(path, "it holds no joints")
    with RecordedCamera(stored.model, [Take(stored.before, stored.frames)]) as camera:
        try:
            detection = tracker.find(camera.snapshot(), camera.model(), stored.X_BC)
            camera.start_recording()
            track = tracker.track(
                TrackRequest(
                    frames=camera.stop_recording(),
                    model=camera.model(),
                    X_BC=stored.X_BC,
                    detection=detection,
                    X_BT_at=X_BT_at,
                    q_at=joints(played),
                    t_start_s=played.t_start_s,
                    duration_s=float(played.t_s[-1]),
                    at_home=stored.at_home,
                )
            )
        except PerceptionError as error:
            return Retracked(record, None, None, None, str(error))
    context = tracker.context(np.array(list(record.drawn_context.values())), detection)
    return Retracked(record, track, task.score(track, context), np.asarray(context), None)


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
        body = topics.Reader(message.data)
        for _ in range(body.count()):
            t_ns, _ = body.header()
            child, xyz, xyzw = body.string(), body.doubles(3), body.doubles(4)
            if child == "tool":
                yield t_ns, xyz, xyzw


def _words(name: str) -> str:
    return name.replace("_", " ")


def _mm(apart_m: float | None) -> float | None:
    return None if apart_m is None else 1e3 * apart_m
