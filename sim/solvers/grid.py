"""The exact solver of a task whose rollouts are cheap, and too irregular for an emulator.

It answers with true rollouts at a grid of parameters that fills the margin: any parameters count as the nearest point
of the grid. If the context moves things, a point has a context too. The nuisance counts as the nearest of a few draws.
Each triple of a point, an action and a draw is simulated once: before a session, or when it is first needed. A task
names this solver as `Task.exact`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array
from sim.errors import CheckpointError
from sim.rollouts.draws import cover, physical_contexts, sobol
from sim.rollouts.run import Requests, Rollouts, observed
from sim.solvers.candidates import FromOutcomes, ListedActionSolver
from sim.solvers.misfit import tolerance
from sim.storage.files import Tensors
from sim.tasks.task import Expectations, Task
from sim.types import PredictedOutcomes

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

GRID, ACTIONS = 64, 64
"""Points of the grid, and actions that policies choose among: 4096 rollouts for each draw of the nuisance."""

MOVED_GRID = 256
"""Points of a grid over parameters and contexts together."""

NUISANCES = 4
"""Draws that stand for the nuisance of a task that has one."""

PROBES = 8
"""Actions by which the error of the grid is measured."""


@dataclass(eq=False)
class _PointRollouts:
    """The rollouts of one action so far, by points of the grid."""

    is_known: NDArray[np.bool_]  # (K,)
    success: Array  # (K,)
    end: Array  # (K, k)
    observation: Array  # (K, size)
    failure_reward: Array  # (K,)

    @classmethod
    def empty(cls, rows: int, end: int, observation: int) -> _PointRollouts:
        """No rollout at any of this number of points, with these sizes of end states and observations."""
        sizes = np.zeros((rows, end)), np.zeros((rows, observation))
        return cls(np.zeros(rows, dtype=bool), np.zeros(rows), *sizes, np.zeros(rows))

    def take(self, at: NDArray[np.intp] | slice, rolled: Rollouts) -> None:
        """Take rollouts at points of the grid as simulated."""
        self.is_known[at] = True
        self.success[at] = rolled.succeeded
        self.end[at] = rolled.successful_ends
        self.observation[at] = rolled.observation
        self.failure_reward[at] = 0.0 if rolled.failure_reward is None else rolled.failure_reward

    def copy(self, rows: NDArray[np.intp], other: _PointRollouts, at: NDArray[np.intp]) -> None:
        """Set rows to the rollouts of another one at points of the grid."""
        for f in fields(self):
            getattr(self, f.name)[rows] = getattr(other, f.name)[at]


@dataclass(frozen=True, eq=False)
class GridSolver(FromOutcomes):
    """The `sim.solvers.solver.Expectations` of true rollouts."""

    task: Task
    points: Array  # (K, p) the grid, in units
    contexts: Array  # (K, c) in which each point is simulated
    probes: Array  # (P, a) actions by which the error of the grid is measured
    draws: Array  # (D, n) of the nuisance, in units
    _simulated: dict[bytes, _PointRollouts] = field(default_factory=dict, repr=False)  # by context, action and nuisance

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_array(self.points, (None, len(self.task.parameters)), "points"))
        shape = (len(self.points), len(self.task.context))
        object.__setattr__(self, "contexts", frozen_array(self.contexts, shape, "contexts"))
        object.__setattr__(self, "probes", frozen_array(self.probes, (None, len(self.task.action)), "probes"))
        object.__setattr__(self, "draws", frozen_array(self.draws, (None, len(self.task.nuisance)), "draws"))

    def trajectories(self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None) -> Array:
        """(N, size)"""
        contexts = np.broadcast_to(self.task.simulated_in(context), (len(parameters), len(self.task.context)))
        lookup = self._looked_up(Requests(parameters, contexts, action, nuisance))
        return self.task.at_context(lookup.observation, context)

    def outcomes(
        self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None
    ) -> PredictedOutcomes:
        """Success (1, ...), and the end state (1, ..., k), 0 after a failure."""
        requests, lead = Requests.broadcast(parameters, self.task.simulated_in(context), action, nuisance)
        lookup, shape = self._looked_up(requests), (1, *lead)
        failed = None if self.task.reward_of_failure is None else lookup.failure_reward.reshape(shape)
        return PredictedOutcomes(lookup.success.reshape(shape), lookup.end.reshape(*shape, -1), failed)

    @cached_property
    def residual_std(self) -> Array:
        """(size,) normalised spread of the errors that arise because parameters count as the nearest point: half of the
        differences between neighbouring points.
        """
        return np.asarray(0.5 * np.sqrt((self._apart**2).mean(axis=(0, 1))))

    @cached_property
    def misfit_limit(self) -> float:
        """The misfit that 95 % of the rollouts at a point have to the nearest of all other points."""
        paths = self._paths
        squared = (((paths[:, :, None] - paths[:, None]) / tolerance(self)) ** 2).mean(axis=-1)
        k = len(self.points)
        squared[:, np.arange(k), np.arange(k)] = np.inf
        return float(np.quantile(np.sqrt(squared.min(axis=2)), 0.95))

    def remember(self, action: Array, nuisance: Array, rollouts: Rollouts) -> None:
        """Take the rollouts of an action (a,) at every point of the grid as simulated."""
        entry = self._simulated[_key(action, nuisance)] = self._nothing(rollouts)
        entry.take(slice(None), rollouts)

    def requests(self, actions: Array) -> Requests:
        """The rollouts of actions (A, a) with every draw at every point, action by action; none if an action is not
        executed exactly.
        """
        if np.any(self.task.action_noise):
            actions = actions[:0]
        k, d, count = len(self.points), len(self.draws), len(actions)
        return Requests(
            np.tile(self.points, (count * d, 1)),
            np.tile(self.contexts, (count * d, 1)),
            np.repeat(actions, k * d, axis=0),
            np.tile(np.repeat(self.draws, k, axis=0), (count, 1)),
        )

    def take(self, actions: Array, rollouts: Rollouts) -> None:
        """Take the rollouts of `requests(actions)` as simulated."""
        k = len(self.points)
        for i, (action, drawn) in enumerate(product(actions, self.draws)):
            self.remember(action, drawn, rollouts[i * k : (i + 1) * k])

    @property
    def tensors(self) -> dict[str, Array]:
        """The rollouts of all actions that are known at every point, for a checkpoint; `restore` reads them."""
        a = len(self.task.action)
        whole = {key: one for key, one in self._simulated.items() if one.is_known.all()}
        inputs = [(np.frombuffer(key[: 8 * a]), np.frombuffer(key[8 * a :])) for key in whole]
        names = {f.name for f in fields(_PointRollouts)} - {"is_known"}
        if self.task.reward_of_failure is None:
            names -= {"failure_reward"}
        if not whole:
            return {}
        return {
            "actions": np.stack([action for action, _ in inputs]),
            "nuisance": np.stack([drawn for _, drawn in inputs]),
        } | {name: np.stack([getattr(one, name) for one in whole.values()]) for name in sorted(names)}

    def restore(self, tensors: Tensors) -> None:
        """Take stored rollouts as simulated. Raises CheckpointError if they are not of this grid."""
        try:
            rows = [tensors[name] for name in ("actions", "nuisance", "success", "end", "observation")]
            unpaid = self.task.reward_of_failure is None
            rows.append(np.zeros_like(tensors["success"]) if unpaid else tensors["failure_reward"])
            for action, nuisance, success, *others in zip(*rows, strict=True):
                if len(success) != len(self.points):
                    raise CheckpointError(
                        f"the checkpoint's grid has {len(success)} points, and this version uses {len(self.points)}: "
                        "pretrain again"
                    )
                is_known = np.ones(len(self.points), dtype=bool)
                self._simulated[_key(action, nuisance)] = _PointRollouts(is_known, success, *others)
        except (KeyError, ValueError) as error:
            raise CheckpointError(f"the checkpoint's grid is incomplete ({error}): pretrain again") from error

    def _looked_up(self, requests: Requests) -> _PointRollouts:
        """The rollouts of N rows; the missing ones are simulated."""
        _, nearest = self._tree.query(self._coordinates(requests.parameters, requests.context))
        at = np.asarray(nearest, dtype=np.intp)
        pairs = np.ascontiguousarray(np.concatenate([requests.action, self._nearest_draws(requests.nuisance)], axis=1))
        _, first, which = np.unique(pairs.view(f"V{pairs[0].nbytes}")[:, 0], return_index=True, return_inverse=True)
        a, rows, order = requests.action.shape[1], len(at), np.argsort(which, kind="stable")
        table: _PointRollouts | None = None
        for one, here in zip(first, np.split(order, np.cumsum(np.bincount(which))[:-1]), strict=True):
            entry = self._outcomes_at(pairs[one, :a], pairs[one, a:], at[here])
            if table is None:
                table = _PointRollouts.empty(rows, entry.end.shape[1], entry.observation.shape[1])
            table.copy(here, entry, at[here])
        if table is None:
            raise ValueError("no rollouts were asked for")
        return table

    def _outcomes_at(self, action: Array, nuisance: Array, points: NDArray[np.intp]) -> _PointRollouts:
        """The known outcomes of an action, at least at `points`."""
        task, key = self.task, _key(action, nuisance)
        entry = self._simulated.get(key)
        missing = np.unique(points if entry is None else points[~entry.is_known[points]])
        if len(missing):
            at = zip(self.points[missing], self.contexts[missing], strict=True)
            rolled = observed(task, [task.simulate(p, context, action, nuisance) for p, context in at])
            if entry is None:
                entry = self._simulated[key] = self._nothing(rolled)
            entry.take(missing, rolled)
        assert entry is not None
        return entry

    def _nearest_draws(self, nuisance: Array) -> Array:
        """(N, n) -> (N, n): for each one the nearest draw."""
        if len(self.draws) == 1:
            return np.tile(self.draws, (len(nuisance), 1))
        normalise = self.task.nuisance.normalise
        gaps = normalise(nuisance)[:, None] - normalise(self.draws)
        return np.asarray(self.draws[(gaps**2).sum(axis=-1).argmin(axis=1)])

    def _nothing(self, like: Rollouts) -> _PointRollouts:
        """No rollout yet at any point, with the same sizes as those of the other actions."""
        return _PointRollouts.empty(len(self.points), like.end_state.shape[1], like.observation.shape[1])

    def _coordinates(self, parameters: Array, contexts: Array) -> Array:
        """(N, p), (N, c) -> (N, d): the coordinates in which the nearest point of the grid is found."""
        moving = self.task.physical_context
        parts = [self.task.margin.normalise(parameters), moving.normalise(contexts[:, : len(moving)])]
        return np.concatenate(parts, axis=1)

    @cached_property
    def _paths(self) -> Array:
        """(P, K, size) trajectories of the probes at every point."""
        every = np.arange(len(self.points))
        pairs = ((action, self.draws[i % len(self.draws)]) for i, action in enumerate(self.probes))
        return np.stack([self._outcomes_at(action, drawn, every).observation for action, drawn in pairs])

    @cached_property
    def _apart(self) -> Array:
        """(P, K, size) differences of these trajectories between each point and the one nearest to it."""
        _, near = self._tree.query(self._coordinates(self.points, self.contexts), k=2)
        return np.asarray(self._paths - self._paths[:, near[:, 1]])

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree  # noqa: PLC0415 - slow to import, and a list of checkpoints needs none

        return cKDTree(self._coordinates(self.points, self.contexts))


def grid_solver(task: Task) -> ListedActionSolver:
    """The solver with `GRID` points of the margin, or `MOVED_GRID` if the context moves things. Its policies choose
    among `ACTIONS` actions that fill their ranges.
    """
    filling = cover(task.action, ACTIONS, np.random.default_rng(0))
    points = MOVED_GRID if len(task.physical_context) else GRID
    return ListedActionSolver(task, grid_of(task, points, filling[:PROBES]), filling)


def grid_of(task: Task, points: int, probes: Array) -> GridSolver:
    """A grid of `points` points, which fill the margin and the contexts that change the physics."""
    p = len(task.margin)
    unit = sobol(points, p + len(task.physical_context), np.random.default_rng(0))
    draws = cover(task.nuisance, draws_of(task), np.random.default_rng(0))
    return GridSolver(task, task.margin.spread(unit[:, :p]), physical_contexts(task, unit[:, p:]), probes, draws)


def draws_of(task: Task) -> int:
    """The number of draws that stand for the nuisance."""
    return NUISANCES if len(task.nuisance) else 1


def grid_behind(solver: Expectations) -> GridSolver | None:
    """The grid behind a solver; None if it has none."""
    return solver.behind if isinstance(solver, ListedActionSolver) and isinstance(solver.behind, GridSolver) else None


def _key(action: Array, nuisance: Array) -> bytes:
    return np.ascontiguousarray(action).tobytes() + np.ascontiguousarray(nuisance).tobytes()
