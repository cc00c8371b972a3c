"""The exact solver of a task whose rollouts are cheap, and too irregular for an emulator.

It answers with true rollouts at a grid of parameters that fills the margin: any parameters count as the nearest point
of the grid. Where the context moves things, a point has a context too. Each pair of a point and an action is simulated
once, when it is first asked for. Name it as `Task.exact`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array
from sim.errors import CheckpointError
from sim.rollouts.draws import cover, physical_contexts, sobol, varies
from sim.rollouts.run import Requests, Rollouts, observed
from sim.solvers.candidates import FromOutcomes, ListedActionSolver
from sim.solvers.misfit import tolerance
from sim.storage.files import Tensors
from sim.tasks.task import Expectations, Task

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

GRID, ACTIONS = 64, 64
"""Points of the grid, and actions that policies choose among: at most 4096 rollouts, each when it is needed."""

MOVED_GRID = 256
"""Points of a grid over parameters and contexts together."""

PROBES = 8
"""Actions by which the error of the grid is measured."""


@dataclass(eq=False)
class _Known:
    """The rollouts of one action so far, by points of the grid."""

    done: NDArray[np.bool_]  # (K,)
    success: Array  # (K,)
    end: Array  # (K, k)
    observation: Array  # (K, size)


@dataclass(frozen=True, eq=False)
class GridSolver(FromOutcomes):
    """The `sim.solvers.solver.Expectations` of true rollouts."""

    task: Task
    points: Array  # (K, p) the grid, in units
    contexts: Array  # (K, c) in which each point is simulated
    probes: Array  # (P, a) actions by which the error of the grid is measured
    _known: dict[bytes, _Known] = field(default_factory=dict, repr=False)  # by context, action and nuisance

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_array(self.points, (None, len(self.task.parameters)), "points"))
        shape = (len(self.points), len(self.task.context))
        object.__setattr__(self, "contexts", frozen_array(self.contexts, shape, "contexts"))
        object.__setattr__(self, "probes", frozen_array(self.probes, (None, len(self.task.action)), "probes"))

    def trajectories(self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None) -> Array:
        """(N, size)"""
        contexts = np.broadcast_to(self.task.simulated_in(context), (len(parameters), len(self.task.context)))
        lookup = self._looked_up(Requests(parameters, contexts, action, nuisance))
        return self.task.at_context(lookup.observation, context)

    def outcomes(
        self, parameters: Array, action: Array, nuisance: Array, context: Array | None = None
    ) -> tuple[Array, Array]:
        """Success (1, ...), and the end state (1, ..., k), 0 after a failure."""
        requests, lead = Requests.broadcast(parameters, self.task.simulated_in(context), action, nuisance)
        lookup = self._looked_up(requests)
        return lookup.success.reshape(1, *lead), lookup.end.reshape(1, *lead, -1)

    @cached_property
    def residual_std(self) -> Array:
        """(size,) spread of the errors because parameters count as the nearest point, normalised: half of the
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
        end = np.where(rollouts.succeeded[:, None], rollouts.end_state, 0.0)
        self._known[_key(action, nuisance)] = _Known(
            np.ones(len(self.points), dtype=bool), rollouts.succeeded.astype(np.float64), end, rollouts.observation
        )

    def requests(self, actions: Array) -> Requests:
        """The rollouts of actions (A, a) at every point, action by action; none if trials of an action differ."""
        if varies(self.task):
            actions = actions[:0]
        k, count = len(self.points), len(actions)
        return Requests(
            np.tile(self.points, (count, 1)),
            np.tile(self.contexts, (count, 1)),
            np.repeat(actions, k, axis=0),
            np.zeros((count * k, len(self.task.nuisance))),
        )

    def take(self, actions: Array, rollouts: Rollouts) -> None:
        """Take the rollouts of `requests(actions)` as simulated."""
        k = len(self.points)
        for i, action in enumerate(actions):
            self.remember(action, np.zeros(len(self.task.nuisance)), rollouts[i * k : (i + 1) * k])

    @property
    def tensors(self) -> dict[str, Array]:
        """The rollouts of all actions that are known at every point, for a checkpoint; `restore` reads them."""
        a = len(self.task.action)
        whole = {key: one for key, one in self._known.items() if one.done.all()}
        inputs = [(np.frombuffer(key[: 8 * a]), np.frombuffer(key[8 * a :])) for key in whole]
        names = {f.name for f in fields(_Known)} - {"done"}
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
            for action, nuisance, success, end, observation in zip(*rows, strict=True):
                if len(success) != len(self.points):
                    raise CheckpointError(
                        f"the checkpoint's grid has {len(success)} points, and this version uses {len(self.points)}: "
                        "pretrain again"
                    )
                done = np.ones(len(self.points), dtype=bool)
                self._known[_key(action, nuisance)] = _Known(done, success, end, observation)
        except (KeyError, ValueError) as error:
            raise CheckpointError(f"the checkpoint's grid is incomplete ({error}): pretrain again") from error

    def _looked_up(self, requests: Requests) -> _Known:
        """The rollouts of N rows; the missing ones are simulated."""
        _, nearest = self._tree.query(self._place(requests.parameters, requests.context))
        at = np.asarray(nearest, dtype=np.intp)
        pairs = np.ascontiguousarray(np.concatenate([requests.action, requests.nuisance], axis=1))
        _, first, which = np.unique(pairs.view(f"V{pairs[0].nbytes}")[:, 0], return_index=True, return_inverse=True)
        a, rows, order = requests.action.shape[1], len(at), np.argsort(which, kind="stable")
        table: _Known | None = None
        for one, here in zip(first, np.split(order, np.cumsum(np.bincount(which))[:-1]), strict=True):
            entry = self._outcomes_at(pairs[one, :a], pairs[one, a:], at[here])
            if table is None:
                k, size = entry.end.shape[1], entry.observation.shape[1]
                table = _Known(np.ones(rows, dtype=bool), np.zeros(rows), np.zeros((rows, k)), np.zeros((rows, size)))
            table.success[here] = entry.success[at[here]]
            table.end[here] = entry.end[at[here]]
            table.observation[here] = entry.observation[at[here]]
        if table is None:
            raise ValueError("no rollouts were asked for")
        return table

    def _outcomes_at(self, action: Array, nuisance: Array, points: NDArray[np.intp]) -> _Known:
        """The known outcomes of an action, at least at `points`."""
        task, key, count = self.task, _key(action, nuisance), len(self.points)
        entry = self._known.get(key)
        missing = np.unique(points if entry is None else points[~entry.done[points]])
        if len(missing):
            at = zip(self.points[missing], self.contexts[missing], strict=True)
            rolled = observed(task, [task.simulate(p, context, action, nuisance) for p, context in at])
            if entry is None:
                k, size = rolled.end_state.shape[1], rolled.observation.shape[1]
                entry = _Known(
                    np.zeros(count, dtype=bool), np.zeros(count), np.zeros((count, k)), np.zeros((count, size))
                )
                self._known[key] = entry
            entry.done[missing] = True
            entry.success[missing] = rolled.succeeded
            entry.end[missing] = np.where(rolled.succeeded[:, None], rolled.end_state, 0.0)
            entry.observation[missing] = rolled.observation
        assert entry is not None
        return entry

    def _place(self, parameters: Array, contexts: Array) -> Array:
        """(N, p), (N, c) -> (N, d): the coordinates in which the nearest point of the grid is found."""
        moving = self.task.physical_context
        parts = [self.task.margin.normalise(parameters), moving.normalise(contexts[:, : len(moving)])]
        return np.concatenate(parts, axis=1)

    @cached_property
    def _paths(self) -> Array:
        """(P, K, size) trajectories of the probes at every point."""
        every, nuisance = (
            np.arange(len(self.points)),
            cover(self.task.nuisance, len(self.probes), np.random.default_rng(0)),
        )
        pairs = zip(self.probes, nuisance, strict=True)
        return np.stack([self._outcomes_at(action, drawn, every).observation for action, drawn in pairs])

    @cached_property
    def _apart(self) -> Array:
        """(P, K, size) differences of these trajectories between each point and the one nearest to it."""
        _, near = self._tree.query(self._place(self.points, self.contexts), k=2)
        return np.asarray(self._paths - self._paths[:, near[:, 1]])

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree  # noqa: PLC0415 - slow to import, and a list of checkpoints needs none

        return cKDTree(self._place(self.points, self.contexts))


def grid_solver(task: Task) -> ListedActionSolver:
    """The solver with `GRID` points of the margin (`MOVED_GRID` where the context moves things), whose policies choose
    among `ACTIONS` that fill their ranges.
    """
    filling = cover(task.action, ACTIONS, np.random.default_rng(0))
    points = MOVED_GRID if len(task.physical_context) else GRID
    return ListedActionSolver(task, grid_of(task, points, filling[:PROBES]), filling)


def grid_of(task: Task, points: int, probes: Array) -> GridSolver:
    """A grid of so many points, which fill the margin and the contexts that move things."""
    p = len(task.margin)
    unit = sobol(points, p + len(task.physical_context), np.random.default_rng(0))
    return GridSolver(task, task.margin.spread(unit[:, :p]), physical_contexts(task, unit[:, p:]), probes)


def grid_behind(solver: Expectations) -> GridSolver | None:
    """The grid that answers for a solver; None if something else does."""
    return solver.behind if isinstance(solver, ListedActionSolver) and isinstance(solver.behind, GridSolver) else None


def _key(action: Array, nuisance: Array) -> bytes:
    return np.ascontiguousarray(action).tobytes() + np.ascontiguousarray(nuisance).tobytes()
