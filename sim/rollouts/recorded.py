"""Recorded trials. Reality is a set of experiments that somebody made, each with its action and its trajectory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array
from perception.types import ObjectTrack
from sim.errors import OutOfRange, RecordingsRefused
from sim.rollouts.draws import cover
from sim.rollouts.trajectories import contradiction, drifts
from sim.tasks.task import Task

NEAR_S = 0.5
"""The first sample of a trial lies at most this long before or after time 0, the start of its motion (s)."""
LONGEST_GAP_S = 0.5
"""Longest time between two samples while the task observes (s)."""
WIDENED = 1.0
"""How far a state may lie outside of the task's usual observations, as a share of their range."""
START_M = 0.10
"""How far from its known start an object may begin (m)."""
_REST_SHARE, _REST_S = 0.01, 0.1
"""An object is at rest if it moves by less than the first value, a share of the range of observations, during the last
seconds (the second value)."""
ASIDE_M, _ASIDE_TRIALS = 0.03, 3
"""The recordings use another frame if the starts of at least as many trials as the second value all lie on the same
side of the known place, with a median distance of more than the first value (m)."""
_ALIKE = 0.002
"""Trajectories that differ by less than this share of the range of observations are the same."""
_COPY, _COPIED_MOVES = 1e-4, 0.05
"""Two shares of the range of observations. Trajectories are copies if they move by more than the second share and agree
within the first at every observed moment."""
LEAST = 8
"""Least number of trials: four for a session of two particles with one trial each, and four for the scores."""


@dataclass(frozen=True, eq=False)
class RecordedTrials:
    """Trials of one task, checked.

    Raises RecordingsRefused if there are too few trials, if a value lies outside of the task's ranges, if times do not
    increase, or if a trial occurs twice. Its message names the trial.
    """

    task: Task
    names: tuple[str, ...]  # N
    contexts: Array | None  # (N, c) in units; None: not recorded, for a task in which a context only scores
    actions: Array  # (N, a) in units
    tracks: tuple[ObjectTrack, ...]
    notes: tuple[str, ...] = ()  # sentences about the reading, without a full stop
    as_written: bool = True  # whether somebody vouches for them, although another reading may fit the simulator better

    def __post_init__(self) -> None:
        task, n = self.task, len(self.names)
        if self.contexts is None and not scores_only(task):
            raise RecordingsRefused(
                f"the context ({', '.join(task.context.names)}) is missing, and in {task.name} it changes the "
                "motion: name its columns"
            )
        object.__setattr__(self, "actions", frozen_array(self.actions, (n, len(task.action)), "actions"))
        if self.contexts is not None:
            object.__setattr__(self, "contexts", frozen_array(self.contexts, (n, len(task.context)), "contexts"))
        if len(self.tracks) != n:
            raise RecordingsRefused(f"there are {n} trials and {len(self.tracks)} trajectories: they must agree")
        for i in range(n):
            self._check(i)
        self._check_duplicates()
        if aside := frame_aside([start_offset_m(task, track, self._context(i)) for i, track in enumerate(self.tracks)]):
            raise RecordingsRefused(aside)

    def __len__(self) -> int:
        return len(self.names)

    def at(self, actions: Array) -> NDArray[np.intp]:
        """The trials of actions (N, a); -1 if an action was not recorded."""
        rows = (self._by_action.get(np.ascontiguousarray(action).tobytes(), -1) for action in actions)
        return np.fromiter(rows, dtype=np.intp, count=len(actions))

    def some(self, rows: NDArray[np.int_]) -> RecordedTrials:
        """Only the trials of these rows."""
        contexts = None if self.contexts is None else self.contexts[rows]
        names, tracks = tuple(self.names[i] for i in rows), tuple(self.tracks[i] for i in rows)
        return replace(self, names=names, contexts=contexts, actions=self.actions[rows], tracks=tracks)

    def split(self, held_out: float, seed: int) -> tuple[RecordedTrials, RecordedTrials]:
        """The trials for a session, and those held out for scores: a share of `held_out`, drawn by `seed`.

        Raises RecordingsRefused if either part has too few trials.
        """
        order = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0x5EC0,))).permutation(len(self))
        count = round(held_out * len(self))
        for rest, what in ((len(self) - count, "for the session"), (count, "to be held out")):
            if rest < LEAST // 2 and (rest or what == "for the session"):
                raise RecordingsRefused(
                    f"of {len(self)} trials, {rest} are left {what}, and {LEAST // 2} are needed: record more, or "
                    "choose another --held-out"
                )
        return self.some(np.sort(order[count:])), self.some(np.sort(order[:count]))

    def permuted(self, seed: int) -> RecordedTrials:
        """The same actions with the trajectories of other trials: a control, from which nothing can be learnt."""
        order = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0x9E47,))).permutation(len(self))
        contexts = None if self.contexts is None else self.contexts[order]
        return replace(self, contexts=contexts, tracks=tuple(self.tracks[i] for i in order))

    def context_of(self, row: int, context: Array) -> Array:
        """(c,) the context of a trial: its own, or the requested `context` if contexts only score in this task."""
        return context if self.contexts is None or scores_only(self.task) else self.contexts[row]

    def rewards(self, rows: Iterable[int], contexts: Array) -> Array:
        """(N,) rewards of trials in contexts (N, c)."""
        pairs = zip(rows, contexts, strict=True)
        return np.array([self.task.score(self.tracks[i], self.context_of(i, context)) for i, context in pairs])

    @cached_property
    def _by_action(self) -> dict[bytes, int]:
        return {action.tobytes(): i for i, action in enumerate(self.actions)}

    def _check(self, i: int) -> None:
        name, track, task = self.names[i], self.tracks[i], self.task
        spaces = [(task.action, self.actions[i], "action")]
        if self.contexts is not None:
            spaces.append((task.context, self.contexts[i], "context"))
        try:
            for space, value, what in spaces:
                space.check(value, what)
        except (OutOfRange, ValueError) as error:
            raise RecordingsRefused(f"trial {name}: {error}; are its columns in the task's units?") from error
        if len(track.t_s) and abs(track.t_s[0]) > NEAR_S:
            raise RecordingsRefused(
                f"trial {name}: its first sample is at {track.t_s[0]:.6g} s, but must lie within {NEAR_S:g} s of "
                "time 0, the start of the motion: subtract the start of the motion from the clock"
            )
        if len(track.t_s) < 2 or (np.diff(track.t_s) <= 0.0).any():
            after = next((float(t) for t, step in zip(track.t_s, np.diff(track.t_s), strict=False) if step <= 0.0), 0.0)
            raise RecordingsRefused(
                f"trial {name}: its times must increase from one sample to the next, but do not after {after:.4g} s"
            )
        columns = max(task.observation.columns) + 1
        if track.state.shape[1] < columns:
            raise RecordingsRefused(
                f"trial {name}: its trajectory needs {columns} columns, and has {track.state.shape[1]}"
            )

        self._check_times(name, track.t_s, track)
        self._check_states(i)

    def _check_times(self, name: str, t_s: Array, track: ObjectTrack) -> None:
        """Refuse times of another clock or unit, and times that do not cover the observation."""
        observation = self.task.observation
        end_s = float(observation.times_s[-1])
        inside = t_s[: int(np.searchsorted(t_s, end_s)) + 1]
        gaps = np.diff(inside)
        if len(gaps) and gaps.max() > LONGEST_GAP_S:
            at_s = float(inside[int(gaps.argmax())])
            raise RecordingsRefused(
                f"trial {name}: after {at_s:.4g} s there is no sample for {gaps.max():.4g} s, limit {LONGEST_GAP_S:g}: "
                "are its times in seconds, of one clock, and is no part lost?"
            )
        if t_s[-1] < end_s and not rests(self.task, track):
            raise RecordingsRefused(
                f"trial {name}: it ends at {t_s[-1]:.4g} s while the object moves, and {self.task.name} observes it "
                f"until {end_s:.4g} s: are its times in seconds?"
            )

    def _check_states(self, i: int) -> None:
        """Refuse states of another unit or of other columns, by the places that the task's object can reach."""
        name, track, task = self.names[i], self.tracks[i], self.task
        observation = task.observation
        columns, wide = list(observation.columns), WIDENED * (observation.high - observation.low)
        states = track.at(observation.times_s)[:, columns]
        low, high = observation.low - wide, observation.high + wide
        outside = np.argwhere((states < low) | (states > high))
        if len(outside):
            row, column = outside[0]
            raise RecordingsRefused(
                f"trial {name}: column {columns[column] + 1} of its state is {states[row, column]:.4g} at "
                f"{observation.times_s[row]:.3g} s, and {task.name} expects {low[column]:.3g} to {high[column]:.3g}: "
                "are the columns of the state in the task's order, its units (m, rad) and its frame, the arm's base?"
            )
        place_m = start_m(task, self._context(i))
        off_m = 0.0 if place_m is None else float(np.linalg.norm(track.at(np.zeros(1))[0, :2] - place_m))
        if place_m is not None and off_m > START_M:
            x, y = track.at(np.zeros(1))[0, :2]
            raise RecordingsRefused(
                f"trial {name}: at time 0 the object lies at ({x:.3f}, {y:+.3f}) m, {1e3 * off_m:.0f} mm from its "
                f"start at ({place_m[0]:.3f}, {place_m[1]:+.3f}) m, limit {1e3 * START_M:.0f}: are x and y in this "
                "order, in m, in the frame of the arm's base, and is time 0 the start of the motion?"
            )

    def _context(self, i: int) -> Array | None:
        return None if self.contexts is None else self.contexts[i]

    def _check_duplicates(self) -> None:
        names = dict[bytes, str]()
        for name, action in zip(self.names, self.actions, strict=True):
            if name in names.values():
                raise RecordingsRefused(f"trial {name} is there twice: remove one of them")
            if (other := names.setdefault(action.tobytes(), name)) != name:
                raise RecordingsRefused(f"trials {other} and {name} have the same action: remove one of them")
        exact = dict[bytes, str]()
        for name, track in zip(self.names, self.tracks, strict=True):
            if not np.ptp(track.state[:, list(self.task.observation.columns)], axis=0).any():
                continue  # an object that stays where it is does so alike in every trial
            content = track.t_s.tobytes() + track.state.tobytes()
            if (other := exact.setdefault(content, name)) != name:
                raise RecordingsRefused(_copy_sentence(other, name, "to the last digit"))


def require_sound(trials: RecordedTrials) -> RecordedTrials:
    """The same trials. Raises RecordingsRefused if they are fewer than `LEAST`, if all went alike (nothing moved, or
    columns name something else), if a trajectory contradicts itself or its action, or if one is a copy of another.
    """
    if len(trials) < LEAST:
        raise RecordingsRefused(f"there are {len(trials)} recorded trials, and at least {LEAST} are needed")
    task, observation = trials.task, trials.task.observation
    states = np.stack([track.at(observation.times_s)[:, list(observation.columns)] for track in trials.tracks])
    spread = np.ptp(states, axis=0) / (observation.high - observation.low)
    if (spread < _ALIKE).all():
        raise RecordingsRefused(
            f"all {len(trials)} trajectories are alike, within {_ALIKE:.1%} of the range of {task.name}: do the "
            "columns of the state name the object, or something that never moves?"
        )
    for i, (name, track) in enumerate(zip(trials.names, trials.tracks, strict=True)):
        context = None if trials.contexts is None else trials.contexts[i]
        if wrong := contradiction(task, track, context, trials.actions[i]):
            raise RecordingsRefused(f"trial {name}: {wrong}")
    for sentence in (copied(task, trials.names, trials.tracks), drifts(task, trials.tracks)):
        if sentence:
            raise RecordingsRefused(sentence)
    return trials


def copied(task: Task, names: Sequence[str], tracks: Sequence[ObjectTrack]) -> str:
    """A sentence about two trials of different actions in which the object moves alike, within less than any noise; ""
    without any.
    """
    sight = task.observation
    rows = np.array([sight.normalise(track.at(sight.times_s)[:, list(sight.columns)]) for track in tracks])
    rows = rows.reshape(len(tracks), -1)
    moves = np.ptp(rows.reshape(len(rows), len(sight.times_s), -1), axis=1).max(axis=1) > _COPIED_MOVES
    moving, sums = np.flatnonzero(moves & np.isfinite(rows).all(axis=1)), rows.sum(axis=1)
    order = moving[np.argsort(sums[moving])]
    for here, i in enumerate(order):
        for j in order[here + 1 :]:
            if sums[j] - sums[i] > _COPY * rows.shape[1]:
                break  # the others lie farther away, because the sum of their differences does
            if np.abs(rows[i] - rows[j]).max() <= _COPY:
                return _copy_sentence(names[min(i, j)], names[max(i, j)], f"within {_COPY:.2%} of the range")
    return ""


def _copy_sentence(first: str, second: str, how: str) -> str:
    return (
        f"trials {first} and {second} have the same trajectory, {how}, under two actions: one of them is a copy, so "
        "remove the wrong one"
    )


def rests(task: Task, track: ObjectTrack) -> bool:
    """Whether the object rests at the end of a track."""
    observation = task.observation
    columns = list(observation.columns)
    lately = track.state[track.t_s >= track.t_s[-1] - _REST_S][:, columns]
    if len(lately) < 2:
        lately = track.state[-2:, columns]
    moved = np.ptp(lately, axis=0) / (observation.high - observation.low)
    return bool((moved < _REST_SHARE).all())


def start_offset_m(task: Task, track: ObjectTrack, context: Array | None) -> Array | None:
    """(2,) the object's place at time 0 relative to its known start; None if the task states no start, or the object
    was not seen.
    """
    place_m = start_m(task, context)
    if place_m is None or track.t_s[0] > 0.0 or track.t_s[-1] < 0.0:
        return None
    return np.asarray(track.at(np.zeros(1))[0, :2] - place_m)


def frame_aside(offsets_m: Sequence[Array | None]) -> str:
    """A sentence about starts (2,) that are all shifted by the same vector, as in another frame; "" if they are not."""
    starts = np.array([offset for offset in offsets_m if offset is not None]).reshape(-1, 2)
    if len(starts) < _ASIDE_TRIALS:
        return ""
    x_m, y_m = median = np.median(starts, axis=0)
    aside_m, spread_m = float(np.linalg.norm(median)), np.linalg.norm(starts - median, axis=1)
    if aside_m <= ASIDE_M or float(np.quantile(spread_m, 0.8)) > aside_m / 3.0:
        return ""
    return (
        f"in {len(starts)} trials the object begins {1e3 * aside_m:.0f} mm aside of its place, by ({1e3 * x_m:+.0f}, "
        f"{1e3 * y_m:+.0f}) mm in the median and always alike (limit {1e3 * ASIDE_M:.0f}): are x and y in the task's "
        "frame? Subtract this offset if the object stood at its place"
    )


def start_m(task: Task, context: Array | None) -> Array | None:
    """(2,) the object's place at the start of a trial in a context (c,); None if the task does not state it."""
    hardware = task.hardware
    if hardware is None:
        return None
    if hardware.standing is not None:
        return np.asarray(hardware.standing.mark_m, dtype=np.float64)
    return None if context is None or scores_only(task) else context[:2]


def scores_only(task: Task) -> bool:
    """Whether a context of the task decides only the reward, and not the motion."""
    if task.relocate is None:
        return not len(task.context)
    contexts = cover(task.context, 4, np.random.default_rng(0)) if len(task.context) else np.zeros((0, 0))
    observation = np.random.default_rng(0).random(task.observation.size)
    return all(np.array_equal(task.relocate(observation, context), observation) for context in contexts)
