"""Compares recorded trials with their commands: does another reading of the tables fit the simulator much better?

A flipped axis, a turned frame, a film at another rate, a late clock, or trajectories that belong to other trials leave
every value inside its range. But they contradict the simulator, which cannot reproduce such trials with any parameters.
For a mistake in only some trials, each trial is examined alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hw.types import Array
from sim.rollouts.draws import Disturbances, sobol
from sim.rollouts.recorded import RecordedTrials
from sim.solvers.misfit import FREEDOM, VALUES, squares
from sim.tasks.task import Expectations, Task

DRAWS, DISTURBED = 256, 4
"""Number of parameter vectors to try for the whole table, and of nuisances with action errors for each trial."""
MOST_TRIALS = 24
"""The most trials of a table that are compared."""
BETTER = 0.75
"""Another reading counts as right if its cost is less than this share of the cost of the table as written."""
FAR, NEAR = 4.0, 1.5
"""A trial alone counts as wrong if its misfit as written exceeds the first value times the limit of misfits, and falls
below the second value times that limit under another reading. No honest trial of drawn worlds does this
(`benchmarks/contradictions.py`)."""
LISTED = 8
"""The most names of trials in a sentence."""
_SHIFTS_S = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
_FACTORS = (0.5, 2.0)
_TURNS_DEG = (10.0, 20.0, 45.0, 90.0, 180.0)


@dataclass(frozen=True, eq=False)
class TableReading:
    """One way to read a table: the observations (N, size) of its trials."""

    words: str  # after "if"
    observations: Array


def readings_of(trials: RecordedTrials) -> tuple[TableReading, ...]:
    """First the table as it is written, then every other reading of it."""
    written, *others = _trial_readings(trials)
    rows = written.observations
    exchanged = (
        TableReading("each trajectory belongs to the trial before it in the list", np.roll(rows, -1, axis=0)),
        TableReading("each trajectory belongs to the trial after it in the list", np.roll(rows, 1, axis=0)),
        TableReading("the trajectories belong to the trials in reversed order", rows[::-1]),
    )
    return (written, *others, *exchanged)


def _trial_readings(trials: RecordedTrials) -> tuple[TableReading, ...]:
    """The readings that change every trial by itself; the first one is the table as it is written."""
    task, tracks = trials.task, trials.tracks
    times_s, columns = task.observation.times_s, list(task.observation.columns)

    def observed(words: str, factor: float, shift_s: float, change: Callable[[Array, Array], Array]) -> TableReading:
        """The true time is `factor` times the recorded one, and `shift_s` later."""
        rows = []
        for track in tracks:
            first = track.state[0, columns]
            rows.append(task.observation.normalise(change(track.at((times_s - shift_s) / factor)[:, columns], first)))
        return TableReading(words, np.array(rows))

    def same(states: Array, first: Array) -> Array:
        return states

    written = observed("nothing is changed", 1.0, 0.0, same)
    timed = [observed(f"the times are multiplied by {factor:g}", factor, 0.0, same) for factor in _FACTORS]
    for shift_s in _SHIFTS_S:
        timed.append(observed(f"the clock starts {shift_s:g} s before the motion", 1.0, -shift_s, same))
        timed.append(observed(f"the clock starts {shift_s:g} s after the motion began", 1.0, shift_s, same))
    turned = [observed(words, 1.0, 0.0, change) for words, change in _frames(task)]
    return (written, *timed, *turned)


def _frames(task: Task) -> list[tuple[str, Callable[[Array, Array], Array]]]:
    """Changes of states (M, k), given the first state (k,)."""
    names = task.observation.curves
    if not names and len(task.observation.columns) == 2:
        turns = [sign * turn for turn in _TURNS_DEG for sign in (1.0, -1.0) if (turn, sign) != (180.0, -1.0)]
        return [
            (
                "y (or the action across) is flipped",
                lambda states, first: first + (states - first) * [1.0, -1.0],
            ),
            ("x is flipped", lambda states, first: first + (states - first) * [-1.0, 1.0]),
            ("x and y are exchanged", lambda states, first: first + (states - first)[:, ::-1]),
            *((f"the states are turned by {turn:+.0f}° about z", _turn(np.deg2rad(turn))) for turn in turns),
        ]
    k = len(task.observation.columns)
    return [(f"{names[i] if names else f'column {i + 1}'} has the other sign", _flip(i, k)) for i in range(k)]


def _turn(angle_rad: float) -> Callable[[Array, Array], Array]:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    R = np.array([[c, -s], [s, c]])
    return lambda states, first: np.asarray(first + (states - first) @ R.T)


def _flip(column: int, columns: int) -> Callable[[Array, Array], Array]:
    signs = np.ones(columns)
    signs[column] = -1.0
    return lambda states, first: states * signs


@dataclass(frozen=True, eq=False)
class ReadingFit:
    """The fit of one reading of a table to the simulator, at the parameters that suit the whole table best."""

    words: str
    cost: float  # mean over the trials, robust; 0: perfect
    fitting: int  # trials within the limit of misfits


def doubt(expectations: Expectations, trials: RecordedTrials) -> str:
    """A sentence, with numbers and without a full stop, about a reading of all or some trials that fits the task's
    simulator much better than the table as written. It is "" if there is no such reading. It is also "" if the solver
    has no limit of misfits, because a solver that simulates would need thousands of rollouts.
    """
    return table_doubt(expectations, trials) or trial_doubt(expectations, trials)


def table_doubt(expectations: Expectations, trials: RecordedTrials) -> str:
    """The sentence of `doubt` about a mistake that all trials have in common."""
    if not math.isfinite(expectations.misfit_limit):
        return ""
    if len(trials) > MOST_TRIALS:
        trials = trials.some(np.unique(np.linspace(0, len(trials) - 1, MOST_TRIALS).astype(np.intp)))
    paths = _paths(expectations, trials)
    written, *others = (_fit(expectations, reading, paths) for reading in readings_of(trials))
    best, n = min(others, key=lambda fit: fit.cost), len(trials)
    if best.cost < BETTER * written.cost:
        return (
            f"the simulator of {trials.task.name} fits {best.fitting} of {n} trials if {best.words}, and "
            f"{written.fitting} of {n} as they are written (misfit {best.cost:.2f} instead of {written.cost:.2f})"
        )
    return ""


def trial_doubt(expectations: Expectations, trials: RecordedTrials) -> str:
    """The sentence of `doubt` about single trials that contradict their actions as written."""
    if not math.isfinite(expectations.misfit_limit):
        return ""
    limit, rereadings = expectations.misfit_limit, dict[str, list[tuple[str, float, float]]]()
    for i, name in enumerate(trials.names):
        words, better, written = _best_reading(expectations, trials.some(np.array([i])))
        if written > FAR * limit and better < NEAR * limit:
            rereadings.setdefault(words, []).append((name, better, written))
    if not rereadings:
        return ""
    words, rows = max(rereadings.items(), key=lambda pair: len(pair[1]))
    better, written = np.median([row[1:] for row in rows], axis=0)
    listed = ", ".join(row[0] for row in rows[:LISTED]) + (" and more" if len(rows) > LISTED else "")
    which = f"{len(rows)} of {len(trials)} trials ({listed})" if len(trials) > 1 else f"trial {listed}"
    return (
        f"the simulator of {trials.task.name} fits {which} only if {words} (misfit {better:.2f} instead of "
        f"{written:.2f}, limit {limit:.2f})"
    )


def _best_reading(expectations: Expectations, trial: RecordedTrials) -> tuple[str, float, float]:
    """The reading of one trial, other than as it is written, that is nearest to the simulator with any parameters; its
    misfit, and that of the trial as it is written.
    """
    paths = _paths(expectations, trial)[0]
    written, *others = (
        (float(np.sqrt(squares(expectations, reading.observations[0], paths).min())), reading.words)
        for reading in _trial_readings(trial)
    )
    better, words = min(others)
    return words, better, written[0]


def _paths(expectations: Expectations, trials: RecordedTrials) -> Array:
    """(N, K, J, size) expected observations of the N trials for K parameters, each with J disturbances."""
    task = expectations.task
    p = len(task.parameters)
    parameters = task.margin.spread(sobol(DRAWS, p, np.random.default_rng(0)))
    unit = sobol(DRAWS * DISTURBED, len(task.action) + len(task.nuisance), np.random.default_rng(1))
    drawn = Disturbances.from_unit(task, unit)
    each = np.repeat(parameters, DISTURBED, axis=0)
    paths = []
    for i, action in enumerate(trials.actions):
        context = task.reference_context if trials.contexts is None else trials.contexts[i]
        contexts = np.broadcast_to(context, (len(each), len(task.context)))
        paths.append(expectations.trajectories(each, action + drawn.error, drawn.nuisance, contexts))
    return np.array(paths).reshape(len(trials), DRAWS, DISTURBED, -1)


def _fit(expectations: Expectations, reading: TableReading, paths: Array) -> ReadingFit:
    pairs = zip(reading.observations, paths, strict=True)
    near = np.array([squares(expectations, row, mine).min(axis=-1) for row, mine in pairs])  # (N, K)
    costs = np.log1p(VALUES * near / FREEDOM).mean(axis=0)
    k = int(costs.argmin())
    return ReadingFit(reading.words, float(costs[k]), int((near[:, k] <= expectations.misfit_limit**2).sum()))
