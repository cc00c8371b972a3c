"""The best policy of a session, to run it or to export it, also with its adapted scene for other simulators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsim_cli.bench.checkpoints import task_of
from adaptsim_cli.config import Config, load
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.screen.outputs.trials import as_row
from adaptsim_cli.session.checkpoint import checkpoint_of_session
from adaptsim_cli.session.history import history_of, results_of
from adaptsim_cli.session.records import ROLLOUT, as_records
from adaptsim_cli.session.running import settings_of
from adaptsim_cli.session.store import SessionStore

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from hw.types import Array
    from sim.adaptation.checkpoint import Checkpoint
    from sim.adaptation.method import Iteration
    from sim.tasks.task import SolvedPolicy, Task
    from sim.types import Space

FORMAT = 1
A_SIDE, MOST = 9, 81
"""Contexts at which a policy is exported: this many along each of two quantities; with more quantities, this many in
all."""


@dataclass(frozen=True)
class BestOfSession:
    """The final policy of a session, and its settings."""

    config: Config
    parameters: dict[str, float]
    history: tuple[Iteration, ...]  # all complete iterations

    def as_typed(self) -> list[str]:
        """The parameters as `--param` takes them."""
        return [f"{name}={value!r}" for name, value in self.parameters.items()]


@dataclass(frozen=True, eq=False, repr=False)
class TaskPolicy:
    """The final policy of a session, for people. Contexts are checked, and may be lists."""

    session: str
    task: Task
    policy: SolvedPolicy

    def __call__(self, context: ArrayLike = ()) -> Array:
        """(c,) in units -> (a,) in units, without the limits of an arm. Raises OutOfRange."""
        return self.policy(self._checked(context))

    def predict(self, context: ArrayLike = ()) -> tuple[float, float, float]:
        """Predicted reward at (c,) in units, and both ends of its 95 % interval. Raises OutOfRange."""
        return self.policy.predict(self._checked(context))

    def __repr__(self) -> str:
        arguments, returned = (
            ", ".join(d.label for d in space.dimensions) for space in (self.task.context, self.task.action)
        )
        return f"<best policy of {self.session}: ({arguments}) -> ({returned})>"

    def _checked(self, context: ArrayLike) -> Array:
        from sim.errors import OutOfRange

        space = self.task.context
        values = np.asarray(context, dtype=np.float64)
        if values.shape != (len(space),):
            needed = ", ".join(d.label for d in space.dimensions) or "nothing"
            raise OutOfRange(f"a context of {self.task.name} has {len(space)} values ({needed}), not {values.size}")
        return space.check(values, "context")


def best_of(store: SessionStore, config: Config) -> BestOfSession:
    """The best policy after the last complete iteration. Raises SessionError before the first one, UsageError for a
    rollout.

    `config` provides the settings that a session does not freeze.
    """
    results = results_of(store)
    name = store.facts.name
    if store.facts.method == ROLLOUT:
        raise UsageError(f"session {name} is a rollout: nothing adapts in it, so it has no best policy")
    if not results:
        raise SessionError(
            f"session {name} has no complete iteration yet, so no best policy: adaptsim run-iteration --session {name}"
        )
    session_config = settings_of(store, config)
    return BestOfSession(
        session_config, results[-1].best.params, history_of(task_of(session_config), store, results[-1].iteration - 1)
    )


def policy_of_session(store: SessionStore, checkpoint: Checkpoint) -> SolvedPolicy:
    """The final policy of a session, without the limits of an arm.

    Raises SessionError before the first complete iteration, CheckpointError.
    """
    from sim.adaptation.judging import final_policy
    from sim.adaptation.methods import make_method

    best, task = best_of(store, load().config), checkpoint.solver.task
    method = make_method(best.config.method, task, checkpoint)
    return final_policy(method, checkpoint.solver, task, best.history)


def export(store: SessionStore) -> dict[str, Any]:
    """The best policy as a table of contexts and actions, for JSON; with the file of each trained policy.

    Raises SessionError, CheckpointError.
    """
    from sim.tasks.library import library_of, main_file

    best = best_of(store, load().config)
    checkpoint = checkpoint_of_session(store)
    task = checkpoint.solver.task
    contexts = contexts_of(task)
    actions = policy_of_session(store, checkpoint).actions(contexts)
    library = library_of(task)
    members = [] if library is None else [library.nearest(task, action) for action in actions]
    trained = {"policies": [{"name": one.name, "file": str(main_file(one).absolute())} for one in members]}
    return (trained if members else {}) | {
        "format": FORMAT,
        "session": store.facts.name,
        "task": task.name,
        "checkpoint": store.facts.checkpoint,
        "checkpoint_sha256": store.facts.checkpoint_sha256,
        "parameters": best.parameters,
        "quantities": {
            "parameters": _described(task.parameters),
            "context": _described(task.context),
            "action": _described(task.action),
        },
        "contexts": [list(as_row(context)) for context in contexts],
        "actions": [list(as_row(action)) for action in actions],
    }


def contexts_of(task: Task) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(G, c) contexts that cover a task's ranges in order; (1, 0) for a task without context."""
    from sim.rollouts.draws import cover

    size = len(task.context)
    if size == 0:
        return np.zeros((1, 0))
    if size > 2:
        return cover(task.context, MOST, np.random.default_rng(0))
    steps: Sequence[Any] = [np.linspace(0.0, 1.0, A_SIDE)] * size
    grid = task.context.denormalise(np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, size))
    return np.unique(grid, axis=0)  # a category, or an integer, has fewer values than there are steps


def _described(space: Space) -> list[dict[str, Any]]:
    words = {d.name: {"plain_name": d.plain, "meaning": d.meaning} for d in space.dimensions}
    return [{**record.model_dump(mode="json"), **words[record.name]} for record in as_records(space)]
