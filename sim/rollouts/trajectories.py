"""Finds trajectories that no object on a table can have, both in recordings and in answers, and names each with its
numbers.

Tasks whose observation is not a place on the table (`Observation.curves`) pass unchecked.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.rollouts.draws import cover
from sim.tasks.task import Task

SPIKE_M, SPIKE_M_S = 0.05, 3.0
"""No object leaves its path for a single sample by this distance and at this speed, and comes back."""
_MOVED, _RESTS, _REST_S = 0.05, 0.01, 0.3
"""An object has moved if it is displaced by more than the first share of the range of observations. It rests if it
stays within the second share for this time (s)."""
_DRAWS = 4
WRONG_WAY_DEG = 30.0
"""The most by which the direction from start to end may differ from those of all simulations."""
DRIFT_M_S, _CREEP_S, _MOVES_M_S, _DRIFTING = 0.003, 0.15, 0.10, 5
"""The positions drift if the objects creep alike in at least as many trials as the last value. Creeping means faster
than the first value (m/s) for the second one (s), both at rest and before they exceed the third (m/s)."""
_FAST_M_S, HELD_S = 0.3, 0.08
"""If a place is repeated for longer than the first value (s) while the object is faster than the second (m/s), it was
not measured again."""
STOPS_M_S2, _FROZEN_STEPS = 15.0, 3
"""Friction stops no object faster than the first value (m/s²). The speed is measured over this many steps, and as many
follow."""
HEIGHT_M = 0.10
"""How far from its known height an object may begin (m)."""


def contradiction(task: Task, track: ObjectTrack, context: Array | None, action: Array) -> str:
    """A sentence about a trajectory that contradicts itself or its action (a,), without a full stop; "" if none does.

    The simulator of the task is used only if a trajectory looks strange.
    """
    if task.observation.curves or not len(track.t_s):
        return ""
    return (
        _spike(task, track)
        or _held(task, track)
        or _frozen(task, track)
        or _wrong_height(task, track)
        or _moved_again(task, track, context, action)
        or _never_moved(task, track, context, action)
        or _wrong_way(task, track, context, action)
    )


def drifts(task: Task, tracks: Sequence[ObjectTrack]) -> str:
    """A sentence about objects that all creep in the same way before they move and after they rest; "" if none."""
    if task.observation.curves:
        return ""
    pairs = [pair for track in tracks if (pair := _creeps_m_s(task, track)) is not None]
    if len(pairs) < _DRIFTING:
        return ""
    before, after = np.median(np.array(pairs), axis=0)
    speed_m_s, apart_m_s = float(np.linalg.norm(after)), float(np.linalg.norm(after - before))
    spread_m_s = np.linalg.norm(np.array(pairs)[:, 1] - after, axis=1)
    if speed_m_s < DRIFT_M_S or apart_m_s > speed_m_s / 2.0 or float(np.quantile(spread_m_s, 0.7)) > speed_m_s:
        return ""
    return (
        f"in {len(pairs)} trials the object creeps by {1e3 * speed_m_s:.0f} mm/s, always alike, before it is moved and "
        f"after it rests, limit {1e3 * DRIFT_M_S:.0f} mm/s: the tracker or its frame drifts"
    )


def _creeps_m_s(task: Task, track: ObjectTrack) -> tuple[Array, Array] | None:
    """Velocities (k,) before the object is moved and after it rests; None if they were not observed."""
    t_s, places_m = track.t_s, track.state[:, list(task.observation.columns)]
    if len(t_s) < 4:
        return None
    moving = np.linalg.norm(np.diff(places_m, axis=0), axis=1) / np.diff(t_s) > _MOVES_M_S
    last, first = np.flatnonzero(t_s >= t_s[-1] - _CREEP_S), int(moving.argmax())  # the last sample before it moves
    if not moving.any() or len(last) < 3 or t_s[first] - t_s[0] < _CREEP_S:
        return None
    start_m_s = (places_m[first] - places_m[0]) / (t_s[first] - t_s[0])
    return start_m_s, (places_m[last[-1]] - places_m[last[0]]) / (t_s[last[-1]] - t_s[last[0]])


def _spike(task: Task, track: ObjectTrack) -> str:
    if len(track.t_s) < 3:
        return ""
    t_s, places_m = track.t_s, track.state[:, list(task.observation.columns)]
    share = ((t_s[1:-1] - t_s[:-2]) / (t_s[2:] - t_s[:-2]))[:, None]
    off_m = np.linalg.norm(places_m[1:-1] - (1.0 - share) * places_m[:-2] - share * places_m[2:], axis=1)
    across_m = np.linalg.norm(places_m[2:] - places_m[:-2], axis=1)
    quick = off_m / np.maximum(t_s[1:-1] - t_s[:-2], t_s[2:] - t_s[1:-1]) > SPIKE_M_S
    spikes = np.flatnonzero(quick & (off_m > SPIKE_M) & (across_m < 0.5 * off_m))
    if not len(spikes):
        return ""
    i = int(spikes[0])
    return (
        f"at {t_s[i + 1]:.4g} s the object lies {1e3 * off_m[i]:.0f} mm off its way, and is back in the next sample: "
        "leave such samples out"
    )


def _steps(task: Task, track: ObjectTrack) -> tuple[Array, Array]:
    """(N-1,) way (m) and time (s) from each sample to the next."""
    way_m = np.linalg.norm(np.diff(track.state[:, list(task.observation.columns)], axis=0), axis=1)
    return way_m, np.diff(track.t_s)


def _held(task: Task, track: ObjectTrack) -> str:
    """Samples that repeat an older place, to the last digit, while the object moves."""
    way_m, _ = _steps(task, track)
    changes = np.flatnonzero(way_m > 0.0) + 1
    if len(changes) < 3:
        return ""
    every_s = np.diff(track.t_s[changes])
    fast = way_m[changes[1:] - 1] / every_s > _FAST_M_S
    repeated = fast & (np.diff(changes) > 1) & (every_s > HELD_S)
    if repeated.sum() < 2 or repeated.sum() <= fast.sum() / 2:
        return ""
    return (
        f"its place is new only every {np.median(every_s[repeated]):.2g} s while the object moves, and repeated in "
        f"between, limit {HELD_S:g} s: leave the repeated samples out, because the object moves on between them"
    )


def _frozen(task: Task, track: ObjectTrack) -> str:
    """Detects an object that moves fast and then never again by a single digit. An object that fell or is lost counts
    as staying.
    """
    way_m, every_s = _steps(task, track)
    changes = np.flatnonzero(way_m > 0.0)
    if not len(changes) or track.outcome in (Outcome.TIPPED, Outcome.LOST):
        return ""
    last = int(changes[-1])
    if not _FROZEN_STEPS <= last + 1 <= len(way_m) - _FROZEN_STEPS:
        return ""
    lately = slice(last + 1 - _FROZEN_STEPS, last + 1)  # one step alone may be the resolution's
    speed_m_s = float(way_m[lately].sum() / every_s[lately].sum())
    if speed_m_s < _FAST_M_S or speed_m_s / every_s[last + 1] < STOPS_M_S2:
        return ""
    return (
        f"the object moves at {speed_m_s:.2g} m/s until {track.t_s[last + 1]:.3g} s, and from then on its place is the "
        "same to the last digit: did its tracker stop?"
    )


def _wrong_height(task: Task, track: ObjectTrack) -> str:
    hardware = task.hardware
    if hardware is None or track.state.shape[1] < 3 or set(task.observation.columns) != {0, 1} or track.t_s[0] > 0.0:
        return ""
    parameters, nuisance = (space.denormalise(np.full(len(space), 0.5)) for space in (task.parameters, task.nuisance))
    height_m = float(hardware.rest_pose(task.reference_context, parameters, nuisance, None)[2, 3])
    z_m = float(track.at(np.zeros(1))[0, 2])
    if abs(z_m - height_m) <= HEIGHT_M:
        return ""
    return (
        f"at time 0 the object's height is {z_m:.3f} m, but the task's object begins at {height_m:.3f} m "
        f"(at most {HEIGHT_M:g} m apart): is z in m, in the frame of the arm's base?"
    )


def _first_rest(task: Task, track: ObjectTrack) -> tuple[int, float, float] | None:
    """Where the object first came to rest after it had moved: the row, how far it moves away later (as a share of the
    range), and when; None if it never comes to rest.
    """
    sight = task.observation
    places = track.state[:, list(sight.columns)] / (sight.high - sight.low)
    moved = np.abs(places - places[0]).max(axis=1) > _MOVED
    if not moved.any():
        return None
    for i in range(int(moved.argmax()), len(places)):
        still = (track.t_s >= track.t_s[i]) & (track.t_s <= track.t_s[i] + _REST_S)
        if track.t_s[-1] < track.t_s[i] + _REST_S:
            return None
        if still.sum() >= 3 and (np.ptp(places[still], axis=0) < _RESTS).all():
            away = np.abs(places[i:] - places[i]).max(axis=1)
            gone = away > _MOVED
            return i, float(away.max()), float(track.t_s[i + int(gone.argmax())]) if gone.any() else float("nan")
    return None


def _moved_again(task: Task, track: ObjectTrack, context: Array | None, action: Array) -> str:
    rest = _first_rest(task, track)
    if rest is None or np.isnan(rest[2]):
        return ""
    for other in _simulated(task, context, action):
        possible = _first_rest(task, other)
        if possible is not None and not np.isnan(possible[2]):
            return ""
    row, away, again_s = rest
    return (
        f"the object comes to rest at {track.t_s[row]:.3g} s and moves again from {again_s:.3g} s on, by {away:.0%} of "
        f"the task's range, which it never does in the simulator: end the trajectory where it first rests"
    )


def _never_moved(task: Task, track: ObjectTrack, context: Array | None, action: Array) -> str:
    if len(track.t_s) < 2 or _way(task, track) > _RESTS or track.outcome is Outcome.LOST:
        return ""
    ways = [_way(task, other) for other in _simulated(task, context, action)]
    if not ways or min(ways) <= _MOVED:
        return ""
    return (
        f"the object never moves, and under this action it moves by {min(ways):.0%} of the task's range or more in "
        f"{len(ways)} of {len(ways)} simulations: did its tracker stop, or does a column name something else?"
    )


def _wrong_way(task: Task, track: ObjectTrack, context: Array | None, action: Array) -> str:
    """Checks a trajectory that has only a start and an end; `sim.solvers.readings` compares whole trajectories."""
    columns = list(task.observation.columns)
    if len(track.t_s) != 2 or len(columns) != 2 or track.outcome is Outcome.LOST:
        return ""
    way = track.state[-1, columns] - track.state[0, columns]
    ways = np.array([one.state[-1, columns] - one.state[0, columns] for one in _simulated(task, context, action)])
    lengths = np.linalg.norm(ways.reshape(-1, 2), axis=1) * float(np.linalg.norm(way))
    if not len(ways) or lengths.min() == 0.0:
        return ""
    off_deg = np.rad2deg(np.arccos(np.clip(ways @ way / lengths, -1.0, 1.0)))
    if off_deg.min() < WRONG_WAY_DEG:
        return ""
    return (
        f"the object went in a direction {off_deg.min():.0f}° or more beside that of {len(ways)} of {len(ways)} "
        f"simulations of this action, limit {WRONG_WAY_DEG:.0f}°: are x and y in this order, and in the task's frame?"
    )


def _way(task: Task, track: ObjectTrack) -> float:
    """How far the object goes, as a share of the range of observations."""
    sight = task.observation
    return float((np.ptp(track.state[:, list(sight.columns)], axis=0) / (sight.high - sight.low)).max())


def _simulated(task: Task, context: Array | None, action: Array) -> list[ObjectTrack]:
    """The trial in the simulator, for parameters and nuisances that cover their ranges."""
    if task.training is not None:
        return []
    rng = np.random.default_rng(0)
    drawn = zip(cover(task.parameters, _DRAWS, rng), cover(task.nuisance, _DRAWS, rng), strict=True)
    at = task.reference_context if context is None else context
    tracks = [task.simulate(parameters, at, action, nuisance) for parameters, nuisance in drawn]
    return [track for track in tracks if track.outcome is not Outcome.SOLVER_FAILED]
