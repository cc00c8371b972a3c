"""The places of benchmark sessions: a simulated world, its table, or recorded trials.

A fourth place, the whole lab with arm and camera, has the same contract (`adaptsim_cli.research.lab_place`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from perception.types import ObjectTrack
from sim.adaptation.method import Trial, trials_of_rows
from sim.lab.rollout import rollout_in
from sim.lab.world import World
from sim.research.benchmark.tables import WorldTable
from sim.rollouts.draws import trial_requests
from sim.rollouts.recorded import RecordedTrials
from sim.rollouts.run import Requests, Rollouts
from sim.tasks.task import Executable, Solver, Task

SMOOTHED = 4
"""Number of a table's rollouts that are averaged for the reward of an action, in the search for the best one."""


class TrialSource(Protocol):
    """One world. Contexts (N, c) and commanded actions (N, a) are in units; all randomness comes from the generator."""

    @property
    def executable(self) -> Executable | None:
        """The test for executable actions; None if all are executable."""

    def play(self, contexts: Array, actions: Array, rng: np.random.Generator) -> tuple[Trial, ...]:
        """Run trials; their observations have the camera's noise."""

    def take(self, action: Array) -> None:
        """Announce the action (a,) of the next trial; recorded trials exist only once."""

    def score(self, contexts: Array, actions: Array, rng: np.random.Generator) -> Array:
        """(N,) rewards of rollouts that `play` never shows."""

    def best_actions(self, contexts: Array) -> Array:
        """(N, a) the best actions according to the data of `play`, which give an upper bound for any method."""


@dataclass(frozen=True, eq=False)
class SimulatedTrials:
    """A `TrialSource` with a true rollout for each trial, for tasks with exact, nearly free answers."""

    solver: Solver
    world: World
    executable: Executable | None = None

    def play(self, contexts: Array, actions: Array, rng: np.random.Generator) -> tuple[Trial, ...]:
        """See `TrialSource`: true rollouts."""
        task, tracks = self.solver.task, self._rolled(contexts, actions, rng)
        shown = np.stack([task.observation(track) for track in tracks])
        observations = task.observation.with_noise(shown, rng)
        return trials_of_rows(contexts, actions, observations, self._scores(tracks, contexts), map(task.end_of, tracks))

    def take(self, action: Array) -> None:
        """See `TrialSource`: any number of times."""

    def score(self, contexts: Array, actions: Array, rng: np.random.Generator) -> Array:
        """See `TrialSource`: true rollouts."""
        return self._scores(self._rolled(contexts, actions, rng), contexts)

    def best_actions(self, contexts: Array) -> Array:
        """The actions of the exact policy for the world's own parameters."""
        truth = self.world.parameters[None, None]
        return self.solver.policies(truth, np.random.default_rng(0))[0].actions(contexts)

    def _rolled(self, contexts: Array, actions: Array, rng: np.random.Generator) -> list[ObjectTrack]:
        where = np.tile(self.world.parameters, (len(contexts), 1))
        requests = trial_requests(self.solver.task, where, contexts, actions, rng)
        rows = zip(requests.context, requests.action, strict=True)
        return [rollout_in(self.world, context, action, self.solver.task) for context, action in rows]

    def _scores(self, tracks: Sequence[ObjectTrack], contexts: Array) -> Array:
        return np.array([self.solver.task.score(track, c) for track, c in zip(tracks, contexts, strict=True)])


@dataclass(frozen=True, eq=False)
class TableTrials:
    """A `TrialSource` that looks up rollouts in a table. It takes the one with the nearest executed action, in
    fractions of ranges, and with the nearest context if that changes the physics.
    """

    task: Task
    table: WorldTable
    executable: Executable | None = None

    def play(self, contexts: Array, actions: Array, rng: np.random.Generator) -> tuple[Trial, ...]:
        """See `TrialSource`: from the half of the table for trials."""
        task, (requests, results) = self.task, self._for_trials
        rollouts = results[self._nearest(requests, contexts, self._executed(actions, rng))]
        observations = task.observation.with_noise(task.at_context(rollouts.observation, contexts), rng)
        return trials_of_rows(contexts, actions, observations, rollouts.rewards(task, contexts), rollouts.ends())

    def take(self, action: Array) -> None:
        """See `TrialSource`: any number of times."""

    def score(self, contexts: Array, actions: Array, rng: np.random.Generator) -> Array:
        """See `TrialSource`: from the half of the table for scores."""
        requests, results = self._for_scores
        return results[self._nearest(requests, contexts, self._executed(actions, rng))].rewards(self.task, contexts)

    def best_actions(self, contexts: Array) -> Array:
        """The best of the table's own actions, each valued by the mean over its nearest ones."""
        requests, results = self._for_trials
        best = []
        for context in contexts:
            everywhere = np.tile(context, (len(requests), 1))
            gaps = self._gaps(requests, everywhere, requests.action)
            together = np.argsort(np.linalg.norm(gaps, axis=-1), axis=1)[:, :SMOOTHED]
            earned = results.rewards(self.task, everywhere)
            best.append(int(np.argmax(earned[together].mean(axis=1))))
        return requests.action[best]

    @cached_property
    def _for_trials(self) -> tuple[Requests, Rollouts]:
        return self.table.half(odd=False)

    @cached_property
    def _for_scores(self) -> tuple[Requests, Rollouts]:
        return self.table.half(odd=True)

    def _executed(self, actions: Array, rng: np.random.Generator) -> Array:
        return np.asarray(actions + rng.uniform(-1.0, 1.0, actions.shape) * self.task.action_noise)

    def _nearest(self, requests: Requests, contexts: Array, executed: Array) -> NDArray[np.intp]:
        gaps = np.linalg.norm(self._gaps(requests, contexts, executed), axis=-1)
        return np.asarray(gaps.argmin(axis=1), dtype=np.intp)

    def _gaps(self, requests: Requests, contexts: Array, executed: Array) -> Array:
        """(N, R, d) between N executed actions, in their contexts, and the R rows of a half of the table."""
        moving = self.task.physical_context

        def coordinates(contexts: Array, actions: Array) -> Array:
            parts = [self.task.action.normalise(actions), moving.normalise(contexts[:, : len(moving)])]
            return np.concatenate(parts, axis=1)

        return coordinates(contexts, executed)[:, None] - coordinates(requests.context, requests.action)[None]


@dataclass(frozen=True, eq=False)
class FromRecordings:
    """A `TrialSource` of recorded trials. Each can be used once, and scores come from those that were held out."""

    shown: RecordedTrials
    held_out: RecordedTrials
    _spent: set[int] = field(default_factory=set, repr=False)  # rows of `shown`

    def executable(self, context: Array, action: Array) -> bool:
        """Whether the action was recorded and is not used yet."""
        row = int(self.shown.at(action[None])[0])
        return row >= 0 and row not in self._spent

    def take(self, action: Array) -> None:
        """See `TrialSource`: from now on the recording is spent."""
        self._spent.add(int(self.shown.at(action[None])[0]))

    def play(self, contexts: Array, actions: Array, rng: np.random.Generator) -> tuple[Trial, ...]:
        """See `TrialSource`: the recordings. Raises ValueError for an action that was not recorded."""
        task, rows = self.shown.task, self.shown.at(actions)
        if (rows < 0).any():
            raise ValueError("nobody recorded the requested action")
        tracks = [self.shown.tracks[row] for row in rows]
        own_contexts = np.stack(
            [self.shown.context_of(row, context) for row, context in zip(rows, contexts, strict=True)]
        )
        observations = np.stack([task.observation(track) for track in tracks])
        return trials_of_rows(
            own_contexts, actions, observations, self.shown.rewards(rows, contexts), map(task.end_of, tracks)
        )

    def score(self, contexts: Array, actions: Array, rng: np.random.Generator) -> Array:
        """See `TrialSource`: the rewards of the recordings held out."""
        return self.held_out.rewards(self.held_out.at(actions), contexts)

    def best_actions(self, contexts: Array) -> Array:
        """The best of the actions held out, in hindsight: no policy can earn more."""
        every = range(len(self.held_out))
        earned = [self.held_out.rewards(every, np.tile(context, (len(every), 1))) for context in contexts]
        return np.asarray(self.held_out.actions[np.argmax(earned, axis=1)])
